"""Records that cross the stages of the estimator: scene, instances, measured objects, options, results."""

__all__ = ["METHODS"]

#: Methods to estimate a scale: the posterior, the posterior of heights only, the paper, and Sucar and Hayet. They are
#: here, because the parser of the command does not import NumPy.
METHODS = ("default", "height", "paper", "sucar")
