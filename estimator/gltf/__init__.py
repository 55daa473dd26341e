"""What a glTF file holds, checked before it is believed: its record, its buffers, its numbers."""
