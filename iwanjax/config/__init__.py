"""Study files: every key checked, every fault told in one line with its file, line and key."""

from iwanjax.config.schema import QsmaSettings
from iwanjax.config.study import Study, load_study

__all__ = ["QsmaSettings", "Study", "load_study"]
