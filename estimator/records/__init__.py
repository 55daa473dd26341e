"""The records that all rooms of the estimator share: scene, instances, measured objects, results."""

__all__ = ["METHODS"]

#: How a scale is estimated: our posterior, ours with heights alone, the paper, and Sucar and Hayet.
METHODS = ("default", "height", "paper", "sucar")
