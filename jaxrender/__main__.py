"""``python -m jaxrender``: the command line."""

from jaxrender.cli import console

if __name__ == "__main__":
    console()
