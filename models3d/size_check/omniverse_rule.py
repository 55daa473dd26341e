"""Rule for NVIDIA's Asset Validator, which loads it from the entry point group `omni.asset_validator`.

If `omniverse-asset-validator` is installed, `omni_asset_validate` has the rule `TrueSizeChecker` in the category
`Metric-Tree`. The interface is documented in "Authoring rules" and "Plugins" of the validator.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

CATEGORY = "Metric-Tree"


class AssetValidatorPlugin:
    """Register the rule when the validator starts, and remove it when it ends."""

    def __init__(self) -> None:
        self._rule: type | None = None

    def on_startup(self) -> None:
        """Register the rule."""
        from omni.asset_validator import register_rule

        self._rule = _rule()
        register_rule(CATEGORY)(self._rule)

    def on_shutdown(self) -> None:
        """Remove the rule."""
        from omni.asset_validator import CategoryRuleRegistry

        if self._rule is not None:
            CategoryRuleRegistry().remove(self._rule)
            self._rule = None


def _rule() -> type:
    """Return the class of the rule; its base class is part of the validator, which is optional."""
    from omni.asset_validator import BaseRuleChecker

    class TrueSizeChecker(BaseRuleChecker):  # type: ignore[misc]
        """Check that the objects of a stage have their true size."""

        def CheckStage(self, stage: Any) -> None:  # noqa: N802 - the validator's name
            """Report each object of the stage that does not have its true size."""
            from metric_base.errors import InputError
            from models3d.size_check.check import check_asset, verdict_line

            file = Path(stage.GetRootLayer().realPath)
            if not file.is_file():
                return
            try:
                checks = check_asset(file)
            except InputError as error:
                self._AddWarning(str(error), at=stage)
                return
            for check in checks:
                if check.is_wrong:
                    self._AddFailedCheck(f"{check.body}: {verdict_line(check)}", at=stage)

    return TrueSizeChecker


plugin = AssetValidatorPlugin()
