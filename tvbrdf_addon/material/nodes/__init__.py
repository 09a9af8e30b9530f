"""A material's nodes: what feeds what, what is ours, and changes that can be taken back."""
