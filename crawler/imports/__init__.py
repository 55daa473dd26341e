"""Importers: an open data set, read by its declaration, into raw items and refusals."""

from crawler.imports.importer import Import, import_items, readings

__all__ = ["Import", "import_items", "readings"]
