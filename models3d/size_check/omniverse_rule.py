"""The check as a rule of NVIDIA's Asset Validator, which finds it by the entry point group `omni.asset_validator`.

With `omniverse-asset-validator` installed beside this package, `omni_asset_validate` has the rule `TrueSizeChecker` in
the category `Metric-Tree`. The interface is that of its documentation, "Authoring rules" and "Plugins".
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

CATEGORY = "Metric-Tree"


class AssetValidatorPlugin:
    """Registers the rule when the validator starts, and takes it back when it ends."""

    def __init__(self) -> None:
        self._rule: type | None = None

    def on_startup(self) -> None:
        """Register the rule."""
        from omni.asset_validator import register_rule

        self._rule = _rule()
        register_rule(CATEGORY)(self._rule)

    def on_shutdown(self) -> None:
        """Take the rule back."""
        from omni.asset_validator import CategoryRuleRegistry

        if self._rule is not None:
            CategoryRuleRegistry().remove(self._rule)
            self._rule = None


def _rule() -> type:
    """The rule's class; its base comes with the validator, which need not be installed."""
    from omni.asset_validator import BaseRuleChecker

    class TrueSizeChecker(BaseRuleChecker):  # type: ignore[misc]
        """The stage is as large as such objects are; if not, the likeliest factor is stated."""

        def CheckStage(self, stage: Any) -> None:  # noqa: N802 - the validator's name
            """Report each object of the stage that is not at true size."""
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
