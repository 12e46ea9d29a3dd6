"""The figures of a report: a file each, or a file for those that belong together."""
