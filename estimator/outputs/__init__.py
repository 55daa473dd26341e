"""What an estimate writes: table, figure, overlay, scaled model."""
