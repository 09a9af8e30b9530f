"""The methods the paper compares with, each fitted to a source and applied to a target."""
