"""What several test files share.  Only fixtures stand in conftest.py, and no test imports a test."""

import pytest

# pytest explains the assertions of test files by itself, those of other modules only where told to beforehand.
pytest.register_assert_rewrite("support.command", "support.pictures")
