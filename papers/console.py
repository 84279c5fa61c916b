"""The console command `contactmodel`: the commands of all four packages.

It is in `papers` because only this package may import the other three.
"""

from calibration.__main__ import app as calibration
from contactmodel.__main__ import app as contactmodel
from contactmodel.common.command_line import make_app, run_app
from estimation.__main__ import app as estimation
from papers.__main__ import app as papers

app = make_app("Contact of two elastic bodies, and the angle of an object held by tactile sensors.")
app.registered_commands.extend(contactmodel.registered_commands)  # beside the groups
app.add_typer(estimation, name="estimation")
app.add_typer(calibration, name="calibration")
app.add_typer(papers, name="papers")


def main() -> None:
    """Run the console command."""
    run_app(app)


if __name__ == "__main__":
    main()
