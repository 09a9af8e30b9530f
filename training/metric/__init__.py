"""How far one material looks from another: the paper's metric, and what it needs."""
