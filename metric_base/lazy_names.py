"""Public names of a package that are imported on first use, so that `import package` is fast (PEP 562)."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module


def lazy_names(
    package: str, modules: Mapping[str, Iterable[str]], others: Mapping[str, Iterable[str]] | None = None
) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """Return the functions `__getattr__` and `__dir__` of a package, and these names as its `__all__`.

    Type checkers find the names by imports in the form `from module import name as name` (PEP 484).

    Parameters
    ----------
    package : str
        `__name__` of the package.
    modules : mapping of str to iterable of str
        Public names by the module of the package that defines them.
    others : mapping of str to iterable of str, optional
        The same for modules of other packages.
    """
    homes = {name: f"{package}.{module}" for module, names in modules.items() for name in names}
    homes |= {name: module for module, names in (others or {}).items() for name in names}

    def attribute(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(homes[name]), name)

    return attribute, lambda: sorted({*vars(sys.modules[package]), *homes}), sorted(homes)
