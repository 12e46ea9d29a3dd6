"""The decision: which causes are named, and the support for them."""
