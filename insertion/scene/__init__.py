"""What is drawn on: the pictures with their poses and times, the coloured cloud, depth and masks of each picture."""
