"""The rendered object into the picture: shadow, occlusion, exposure, blur and grain."""
