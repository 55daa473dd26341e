"""SVG drawings of sizes, made as text: distributions, length against height, an object to scale, the tree as areas."""
