"""Collection: crawlers and importers that turn pages and open tables into raw items."""
