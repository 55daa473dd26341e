"""Evidence for the scale beside the objects: each kind reads what it needs and says one log scale and its spread."""
