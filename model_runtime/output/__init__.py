"""Results as files: made out of sight, committed whole or not at all."""
