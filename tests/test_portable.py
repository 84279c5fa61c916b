"""Nothing that only one kind of operating system has is imported, and no user's folder is."""

import ast
import subprocess
import sys

import pytest

from tests.structure import PACKAGES, ROOT, needs_sources

# of the standard library's index, marked "Availability: Unix"
POSIX = {"fcntl", "grp", "posix", "pty", "pwd", "resource", "syslog", "termios", "tty"}


@needs_sources
@pytest.mark.parametrize("package", PACKAGES)
def test_no_module_is_imported_that_windows_lacks(package):
    for path in sorted((ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            else:
                continue
            assert not {name.split(".")[0] for name in names} & POSIX, path


def test_console_command_leaves_a_users_folders_alone(tmp_path):
    """It runs as installers write it: a script in a folder of its own."""
    script = tmp_path / "bin" / "contactmodel"
    script.parent.mkdir()
    script.write_text(
        f"import sys\nsys.path.insert(1, {str(ROOT)!r})\n"
        "from papers.console import main\nsys.exit(main())\n"
    )
    here = tmp_path / "work"
    for name in PACKAGES:
        (here / name).mkdir(parents=True)
        (here / name / "__init__.py").write_text("raise SystemExit('a folder of the user')")
    command = [sys.executable, str(script), "estimation", "fetch", "--help"]
    done = subprocess.run(command, cwd=here, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Usage: contactmodel estimation fetch" in done.stdout
