"""Records that cross the stages of the estimator: scene, instances, measured objects, options, results."""

__all__ = ["METHODS"]

#: Methods to estimate a scale: the posterior, the posterior of heights only, the paper, and Sucar and Hayet. They are
#: here, because the parser of the command does not import NumPy.
METHODS = ("default", "height", "paper", "sucar")

# Modules, their limits, and their tests in `tests/estimator/records`:
# - digests: Digests of the inputs of a result, as they were read: independent of later changes of the files.
# - network_outputs: Files and conventions of networks that write depths or points with cameras, as found in the code of
#   each project. Limits: OTHER_NETWORK_SD, TABLETOP_SD, MAX_TABLETOP_M. Tests: ../scene_formats/test_networks.py.
# - objects: Measured objects of a scene, with their boxes, tracks, vertical and support planes; format `objects/1`.
#   Limits: ETA_THRESHOLD. Tests: test_result.py.
# - options: Options of an estimate and of the measurement of objects. Tests: test_result.py.
# - result: The result of an estimate (`ScaleResult`, format `metric-tree/scale/1`, see docs/reference/formats.md) and
#   its parts. Limits: DOUBT, DIGITS. Tests: test_result.py.
# - scene: A reconstruction (`Scene`) with its cameras, views, points and instances, validated when it is constructed.
#   Limits: MAX_COORDINATE. Tests: test_scene.py.
