"""A real browser for the live page, as the replay's tests have it."""

from tests.viewer.conftest import browser, window  # noqa: F401 - fixtures
