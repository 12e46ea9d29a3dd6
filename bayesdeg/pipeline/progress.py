"""Names of `bayesdeg.progress` for modules that still look for them here."""

from bayesdeg.progress import Progress as Progress
from bayesdeg.progress import Silent as Silent
