"""Model files: safetensors with a card, checked before anything in them is believed."""
