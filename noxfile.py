#!/usr/bin/env -S uv run --script
# /// script
# dependencies = ["nox>=2024.4.15"]
# ///
"""The tasks of CONTRIBUTING.md, each in an environment of its own: ``nox -s tests``; ``nox -l`` lists them."""

from __future__ import annotations

import nox

nox.needs_version = ">=2024.4.15"
nox.options.default_venv_backend = "uv|virtualenv"


@nox.session
def tests(session: nox.Session) -> None:
    """Run the quick tests, some minutes."""
    session.install("-e", ".[test]")
    session.run("python", "-m", "pytest", "-n", "2", *session.posargs)


@nox.session(default=False)
def slow(session: nox.Session) -> None:
    """Run the slow tests."""
    session.install("-e", ".[test]")
    session.run("python", "-m", "pytest", "-m", "slow", "-n", "2", *session.posargs)


@nox.session
def lint(session: nox.Session) -> None:
    """Run the linters."""
    session.install("ruff")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")


@nox.session
def types(session: nox.Session) -> None:
    """Check the types."""
    session.install("-e", ".[test]")
    session.run("mypy")


@nox.session(default=False)
def docs(session: nox.Session) -> None:
    """Draw the pictures and build the site in site/, some minutes."""
    session.install("-e", ".[docs,sweep]")
    session.run("python", "docs/build.py", *session.posargs)


@nox.session(default=False, venv_backend="none")
def ci(session: nox.Session) -> None:
    """Run all that must pass, on a copy of the tracked files."""
    session.run("bash", ".ci/run", external=True)


if __name__ == "__main__":
    nox.main()
