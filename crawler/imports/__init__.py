"""Importers of open data sets: declared tables and special readers to raw items."""

from crawler.imports.importer import Import, import_source, row_items

__all__ = ["Import", "import_source", "row_items"]
