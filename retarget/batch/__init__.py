"""Many clips, each retargeted by itself: where they are, one clip to one row, the index, and the engines that share the
work."""
