"""summary.json for CI services, spreadsheets and people: JUnit XML, CSV, Markdown; all are views of it."""

import csv
import io
import re
from typing import Any
from xml.etree import ElementTree

from numerics.status import RunStatus

Json = dict[str, Any]
#: what no XML may hold
_NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
#: first letters of a text that spreadsheets take for a formula
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def check_name(check: Json) -> str:
    """Name of a check in tables."""
    return f"{check['metric']} of {check['run']} against {check['against']}"


def check_sentence(check: Json) -> str:
    """What was found, in numbers."""
    if check["error"] is None:
        return check["note"] or "no value"
    target = "" if check["target"] is None else f", target {check['target']:.6g}"
    kind = "relative" if check["measure"] == "relative" and check["target"] is not None else "absolute"
    return (
        f"value {check['value']:.6g}{target}, {kind} error {check['error']:.3g}, limit {check['limit']:.3g}"
    )


def failed_runs(case: Json) -> list[str]:
    """One sentence for each run that the solver did not bring to a good end."""
    runs = case["runs"].items()
    return [f"{n}: {r['status']}: {r['reason']}" for n, r in runs if RunStatus(r["status"]).failed]


def suspect_runs(case: Json) -> list[str]:
    """One sentence for each doubt that the health record of a run raises."""
    return [f"{name}: suspect: {told}" for name, entry in case["runs"].items() for told in entry["suspicions"]]


def needed_records(case: Json) -> list[str]:
    """One sentence for each record of a measured motion that runs need and that is not on this machine."""
    runs = case["runs"].values()
    return list(dict.fromkeys(run["reason"] for run in runs if run["status"] == RunStatus.NEEDS_RECORD))


def junit_xml(summary: Json) -> str:
    """JUnit XML: a suite for each case, a test for each run and each check."""
    root = ElementTree.Element("testsuites", name="verify")
    for case in summary["cases"]:
        suite = ElementTree.SubElement(root, "testsuite", name=f"{case['case']} ({case['tier']})")
        for name, entry in case["runs"].items():
            _junit_run(suite, case, name, entry)
        for check in case["checks"]:
            _junit_check(suite, case, check)
        if case["verdict"] == "NOT_CHECKED":
            test = ElementTree.SubElement(suite, "testcase", classname=case["case"], name="checks")
            ElementTree.SubElement(test, "failure", message="nothing was checked")
        _junit_counts(suite)
    ElementTree.indent(root)
    text = _NO_XML.sub("\N{REPLACEMENT CHARACTER}", ElementTree.tostring(root, encoding="unicode"))
    return f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n'


def _junit_run(suite: ElementTree.Element, case: Json, name: str, entry: Json) -> None:
    seconds = str(entry["seconds"].get("total", 0.0))
    test = ElementTree.SubElement(suite, "testcase", classname=case["case"], name=f"run {name}", time=seconds)
    status = RunStatus(entry["status"])
    if status.failed or status == RunStatus.DAMAGED:
        ElementTree.SubElement(test, "error", message=f"{entry['status']}: {entry['reason']}")
    elif not status.good:
        ElementTree.SubElement(test, "skipped", message=f"{entry['status']}: {entry['reason']}")
    elif entry["suspicions"]:
        ElementTree.SubElement(test, "failure", message=f"suspect: {'; '.join(entry['suspicions'])}")


def _junit_check(suite: ElementTree.Element, case: Json, check: Json) -> None:
    test = ElementTree.SubElement(suite, "testcase", classname=case["case"], name=check_name(check))
    message = check_sentence(check)
    if check["verdict"] in ("FAIL", "MISSING"):
        failure = ElementTree.SubElement(test, "failure", message=f"{check['verdict']}: {message}")
        failure.text = check["reason"]
    elif check["verdict"] == "NEEDS_RECORD":
        ElementTree.SubElement(test, "skipped", message=message)
    elif check["verdict"] == "INFO":
        ElementTree.SubElement(test, "skipped", message=f"not gated: {message}")


def _junit_counts(suite: ElementTree.Element) -> None:
    suite.set("tests", str(len(suite.findall("testcase"))))
    for kind, attribute in (("failure", "failures"), ("error", "errors"), ("skipped", "skipped")):
        suite.set(attribute, str(len(suite.findall(f"testcase/{kind}"))))


def checks_csv(summary: Json) -> str:
    """One row for each check of each case; a text that spreadsheets would run gets an apostrophe before it."""
    columns = ["case", "tier", "metric", "run", "against", "value", "target", "error", "limit", "measure",
               "margin_used", "verdict", "gate", "reason", "source", "note"]  # fmt: skip
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for case in summary["cases"]:
        rows = ({"case": case["case"], "tier": case["tier"]} | check for check in case["checks"])
        writer.writerows({key: _harmless(value) for key, value in row.items()} for row in rows)
    return text.getvalue()


def _harmless(value: Any) -> Any:
    return f"'{value}" if isinstance(value, str) and value.startswith(_FORMULA) else value


def markdown(summary: Json) -> str:
    """A page for a CI service: the verdicts, then all that is not within tolerance."""
    lines = [
        f"# Verification, tier {summary['tier']}",
        "",
        f"Version {summary['version']}, {summary['created']}",
        "",
    ]
    lines += ["| case | verdict | checks passed | largest share of a limit |", "|---|---|---|---|"]
    lines += [_markdown_row(case) for case in summary["cases"]]
    for case in summary["cases"]:
        problems = [f"- {sentence}" for sentence in (*failed_runs(case), *suspect_runs(case), *needed_records(case))]
        bad = (check for check in case["checks"] if check["verdict"] in ("FAIL", "MISSING"))
        problems += [f"- {c['verdict']}: {check_name(c)}: {check_sentence(c)}" for c in bad]
        if problems:
            lines += ["", f"## {case['case']}: {case['verdict']}", "", *problems, "", f"`{case['command']}`"]
    return "\n".join(lines) + "\n"


def counts(case: Json) -> tuple[int, int, float | None]:
    """Gated checks passed, gated checks in all, largest share of a limit that a gated check uses."""
    gated = [check for check in case["checks"] if check["gate"]]
    margins = [check["margin_used"] for check in gated if check["margin_used"] is not None]
    passed = sum(check["verdict"] == "PASS" for check in gated)
    return passed, len(gated), max(margins, default=None)


def _markdown_row(case: Json) -> str:
    passed, gated, margin = counts(case)
    share = "" if margin is None else f"{100 * margin:.0f} %"
    return f"| {case['case']} | {case['verdict']} | {passed} of {gated} | {share} |"
