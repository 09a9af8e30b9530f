"""From what `--input` names to maps of a material."""
