"""A finished run for a person to look at: pictures, animations, a page with its player, and the files of a command."""
