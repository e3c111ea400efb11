"""The command line as ``python -m lcpimpact``."""

from lcpimpact.cli.main import main

main()
