"""``python -m iwanjax``."""

from iwanjax.cli import main

main()
