"""A plugin of pytest: counts skipped tests as those in Rust are counted (crate foveate-testing)."""

from __future__ import annotations

import os

import pytest


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Records skipped tests in the file that FOVEATE_SKIPPED names."""
    path = os.environ.get("FOVEATE_SKIPPED")
    if report.skipped and path and isinstance(report.longrepr, tuple):
        reason = report.longrepr[2].removeprefix("Skipped: ").removeprefix("skipped: ")
        with open(path, "a", encoding="utf-8") as file:
            file.write(f"{report.nodeid}: {reason}\n")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]):  # type: ignore[no-untyped-def]
    """Fails skipped tests where FOVEATE_STRICT is 1."""
    report = yield
    if report.skipped and os.environ.get("FOVEATE_STRICT") == "1":
        report.outcome = "failed"
    return report
