"""Effects with physics of their own, planted in virtual experiments: independent of the causes."""
