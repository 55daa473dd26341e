"""One parsed page to one raw item; knows no network."""
