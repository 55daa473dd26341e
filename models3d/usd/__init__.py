"""Reader and writer of Universal Scene Description files."""
