"""Conclusions from the published numbers of Nagai, Kurita, Shintake (2021)."""
