"""Virtual objects in pictures and video at their true size: models, places, light, rendering, compositing, exports."""
