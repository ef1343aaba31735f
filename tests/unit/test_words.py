"""`make words` counts the sentences that a person wrote."""

from __future__ import annotations

from benchmarks.words import Text, row


def test_sentences_end_at_full_stops_items_and_paragraphs() -> None:
    text = Text(
        "page",
        "First one here. Second `a. B` here:\n\n* an item\n* one more item\n\nArgs:\n    name: the word\n",
    )
    assert text.sentences() == [
        "First one here.",
        "Second code here:",
        "an item",
        "one more item",
        "name: the word",
    ]


def test_a_link_counts_its_text_and_not_its_target() -> None:
    assert Text("page", "See [the page](a/very.long/target here.md) now.").sentences() == [
        "See [the page] now."
    ]


def test_the_row_counts_length_numbers_and_patterns() -> None:
    long = "word " * 30 + "end."
    texts = [Text("a", long), Text("b", "It is no list: 1, 2.5 and -3 are such numbers.")]
    assert row(texts) == ["2", "21.0", "50.0 %", "50.0 %", "0", "1", "1", "0"]
