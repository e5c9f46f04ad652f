"""The documentation site: its pages are made, their links lead somewhere, and no sentence stands on two of them."""

import importlib.util
import re
from collections import Counter
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def site() -> object:
    spec = importlib.util.spec_from_file_location("site_pages", REPOSITORY / "docs" / "site.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_pages_have_links_that_lead_somewhere_and_no_sentence_twice(site: object) -> None:
    pages = site.pages()  # type: ignore[attr-defined]
    assert {"index.md", "metrics.md", "splits.md", "case_file.md", "cases/sen_tension.md"} <= pages.keys()
    assert site.dead_links(pages) == []  # type: ignore[attr-defined]
    assert site.dead_links({"a.md": "[b](c.md)"}) == ["a.md: c.md"]  # type: ignore[attr-defined]
    ours = {file: text for file, text in pages.items() if not file.startswith("cases/")}
    told = Counter(sentence for text in ours.values() for sentence in {*_sentences(text)})
    assert [sentence for sentence, times in told.items() if times > 1] == []


def _sentences(text: str) -> list[str]:
    plain = " ".join(re.sub(r"(?s)```.*?```", "", text).split())
    return [part for part in re.split(r"(?<=[.;:]) ", plain) if len(part) > 60]
