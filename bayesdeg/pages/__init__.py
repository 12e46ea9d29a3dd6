"""Run folders, and the HTML report built from them."""
