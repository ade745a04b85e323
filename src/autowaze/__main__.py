"""`python -m autowaze`."""

from autowaze.cli.main import run

if __name__ == "__main__":
    run()
