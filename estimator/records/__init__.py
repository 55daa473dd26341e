"""The records that all rooms of the estimator share: scene, instances, measured objects, results."""
