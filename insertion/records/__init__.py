"""What the rooms share: the scale and the result (`metric-tree/insertion/1`), and the encoding of pictures."""
