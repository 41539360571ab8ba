"""`python -m benchmark` is `bench`."""

from benchmark.cli.app import main

main()
