"""Where an object is to stand: support planes, points in pictures, free space, headings."""
