"""Section on what was done: enough to do it again."""

from lab.library.result import Result
from lab.library.run_folder import command_line, run_config
from lab.report.document import PAGE, Code, CommandText, Paragraph, Row, Section, Table

__all__ = ["provenance_section"]

_SHOWN = ("robot", "instrument", "seed")  # also where they are at their defaults


def provenance_section(result: Result) -> Section:
    """Build the section on what was done: command, options, versions and the digest of the model."""
    name, options = result.command, result.options
    config = run_config(name, options, result.model_sha256)
    libraries = ", ".join(f"{library} {version}" for library, version in config["versions"].items())
    rows: list[Row] = [(key, str(config["options"][key])) for key in _SHOWN if config["options"].get(key) is not None]
    rows += [("serial", result.serial)] if result.serial is not None else []
    rows += [("versions", libraries), ("model (SHA-256)", Code(result.model_sha256))]
    text = "All other options had their defaults; the run's config.json holds every one"
    return Section(
        "What was done",
        (CommandText(command_line(name, options)), Paragraph(f"{text}."), Table(("", ""), tuple(rows))),
        shown_in=PAGE,
    )
