"""No two sentences of a page contradict each other, whatever AV it is about; flaws are named, good AVs not accused.

The page is read as a person reads it: its text, its tables and what its player shows. `CONTRADICTIONS` lists, in plain
words, what must never stand side by side; the numbers measured with it are in docs/adr/0069-one-judgement.md.
"""

from __future__ import annotations

import html
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pytest
from html_page import Page

import cornerforge

STRANGERS = Path(__file__).parents[1] / "avs_of_a_stranger"
GOOD = ""
"""What is wrong with an AV in which its author knows of no flaw."""

NATURAL = "natural"
AVS: dict[str, tuple[str, str]] = {
    "idm-mobil": ("lane-changer", GOOD), "rss-cautious": ("uniform", GOOD), "cc-human": ("lane-changer", GOOD),
    "strangers:Cautious": ("lane-changer", GOOD), "strangers:Brisk": ("lane-changer", GOOD),
    "strangers:LaneKeeper": ("lane-changer", GOOD), "strangers:Krauss": ("lane-changer", GOOD),
    "idm-mobil-blind": ("lane-changer", "goes by lane centres and sees nobody's lane change"),
    "flawed-brakes-late": (NATURAL, "heeds a vehicle ahead only when it would reach it within 1 s"),
    "flawed-not-behind": (NATURAL, "looks for nobody behind it when it changes lanes"),
    "flawed-not-left": ("lane-changer", "sees nobody to its left"),
    "flawed-too-close": ("uniform", "follows with a time gap of 0.2 s"),
    "flawed-forgets": ("lane-changer", "drops a vehicle from its list 2 s after it came near"),
    "flawed-hesitates": ("lane-changer", "returns to its lane, without looking, when it has left it"),
    "strangers:CutInSleeper": ("lane-changer", "heeds who cuts in only when he is almost in mid-lane"),
    "strangers:SoftPedal": ("uniform", "never brakes harder than 2 m/s2"),
    "strangers:SideTwitcher": ("lane-changer", "steers at the neighbour beside it, and catches itself"),
    "strangers:BumperHugger": ("uniform", "follows with a time gap of 0.35 s"),
    "strangers:GateCloser": ("lane-changer", "speeds up when somebody moves into its lane"),
    "strangers:HalfwayQuitter": ("swerve", "gives up lane changes astride the line"),
    "strangers:ForwardOnly": ("lane-changer", "changes lanes by what is ahead alone"),
    "strangers:TwoOverBlind": ("swerve", "overlooks who comes into the same lane from the far side"),
    "strangers:TrackDropper": ("uniform", "loses the vehicle ahead for 2.5 s"),
    "strangers:ClosingMisjudge": ("uniform", "takes every speed difference above 3 m/s for 3 m/s"),
    "strangers:CutInPanic": ("lane-changer", "brakes with 7.5 m/s2 for any cut-in, even far away"),
    "strangers:GhostBraker": ("lane-changer", "brakes with 6 m/s2 for nothing"),
}  # fmt: skip
"""AV -> whose crashes are looked at, and what its author says is wrong with it."""

_TAGS = re.compile(r"<[^>]+>")
_N = r"([\d,]+)"


def _plain(markup: str) -> str:
    return " ".join(html.unescape(_TAGS.sub(" ", markup)).split())


def _number(words: str) -> float:
    return float(words.replace(",", ""))


@dataclass(frozen=True)
class Told:
    """What a page says of one case: its title, its verdict, its row among the cases of most value, and its motion."""

    title: str
    verdict: str
    row: dict[str, str]
    moved_m: tuple[float, float]

    @property
    def words(self) -> str:
        return f"{self.row.get('what happened', '')} {self.verdict}"


class Said:
    """What a page says.

    Args:
        file: The page.
        forged: What a text is replaced by before it is read: (a pattern, other words).
    """

    def __init__(self, file: Path, forged: tuple[str, str] | None = None) -> None:
        source = re.sub(r"<script>.*?</script>", "", file.read_text(encoding="utf-8"), flags=re.S)
        if forged is not None:
            source, n = re.subn(*forged, source)
            assert n > 0, f"nothing to forge: {forged[0]}"
        read = file.with_name("read.html")
        read.write_text(source, encoding="utf-8")
        self.page = Page(read)
        self.text = " ".join(self.page.text.split())
        self._tables = re.findall(r"<table.*?</table>", source, re.S)

    def share(self, pattern: str) -> float | None:
        """The first per cent that a pattern captures; None: the page does not say it."""
        found = re.search(pattern, self.text)
        return None if found is None else _number(found[1])

    @property
    def flaw(self) -> str:
        """The first answer, "" for none."""
        found = re.search(
            r"What does it do wrong\? (?:It (.*?) In [\d.]+ % of its|No flaw of its own was found)", self.text
        )
        assert found is not None
        return found[1] or ""

    @property
    def flaw_share(self) -> float:
        return self.share(r"In ([\d.]+) % of its (?:natural )?crashes") or 0.0

    @property
    def wrong(self) -> float:
        """Cases in which it did something wrong, where no flaw is named."""
        return self.share(rf"In {_N} of them it did something wrong") or 0.0

    @property
    def careful(self) -> float:
        """The share in large type that a careful driver would have prevented [%]."""
        found = re.search(r"prevented it\? (?:None|In ([\d.]+) %) of them", self.text)
        assert found is not None
        return _number(found[1] or "0")

    def table(self, caption: str) -> tuple[int, dict[str, list[str]]]:
        """n of a table, and its rows by their head; (0, {}) where there is none."""
        for table in self._tables:
            found = re.search(rf"<caption>{caption}, n = {_N}</caption>", table)
            if found is not None:
                rows = re.findall(r"<tr><th scope=\"row\">(.*?)</tr>", table, re.S)
                cells = [list(map(_plain, re.split(r"</t[hd]>", row)))[:-1] for row in rows]
                return int(_number(found[1])), {cell[0]: cell[1:] for cell in cells}
        return 0, {}

    @cached_property
    def cases(self) -> list[Told]:
        """All that is said of each case that can be played."""
        table = next((one for one in self._tables if ">own doing</th>" in one), "")
        heads = [_plain(head) for head in re.findall(r"<th scope=\"col\">(.*?)</th>", table)]
        rows = {}
        for row in re.findall(r"<tr><th scope=\"row\".*?</tr>", table, re.S):
            cells = list(map(_plain, re.split(r"</t[hd]>", row)))[:-1]
            rows[cells[0].rsplit("case ", 1)[1]] = dict(zip(heads, cells, strict=True))
        return [
            Told(case["title"], case["verdict"], rows.get(case["id"], {}), _moved(case))
            for case in self.page.data("cases")
        ]


def _moved(case: dict[str, Any]) -> tuple[float, float]:
    """How far AV and partner moved sideways within the last 10 s before the contact [m], as the player shows it."""
    ends = [vehicle["y"][-100:] for vehicle in (case["vehicles"][0], case["vehicles"][case["partner"]])]
    return max(ends[0]) - min(ends[0]), max(ends[1]) - min(ends[1])


def _some(said: Said, wrong: Callable[[Told], bool]) -> str:
    return next((f"{one.title}: {one.words}" for one in said.cases if wrong(one)), "")


_WOULD = "A careful driver would have"
_OWN = "The AV's own doing"
_AV_MOVES = re.compile(r"^(The AV changes lanes|The AV cuts in|Both enter|Each enters)")
_OTHER_MOVES = re.compile(r"^(Another vehicle changes lanes|Another vehicle cuts in|Both enter|Each enters)")
_VISIBLE_M = 0.2
_WHOLES = ("Cases by what the AV did wrong", "Cases by fault", "Cases looked at")
_DOING = "Cases by what the AV did wrong"
_NOT_WRONG = "nothing that is the AV's own doing"


def _wrong_rows(said: Said) -> int:
    return sum(int(_number(row[0])) for name, row in said.table(_DOING)[1].items() if name != _NOT_WRONG)


def _not_a_whole(said: Said) -> str:
    """Name a table whose cases or shares are not the whole."""
    for caption in _WHOLES:
        n, rows = said.table(caption)
        cases = sum(_number(row[0]) for row in rows.values())
        shares = sum(_number(row[1].removesuffix(" %")) for row in rows.values())
        if rows and (cases != n or abs(shares - 100.0) > 0.06 * len(rows)):
            return f"{caption}: {cases} of {n}, {shares} %"
    return ""


def _parts(said: Said) -> Iterator[tuple[float, float]]:
    """Each share of careful drivers, and what its parts sum to."""
    pattern = r"by braking, ([\d.]+) % by leaving out what the AV began"
    for share, at in ((said.careful, 0), (said.share(_SECTION), 1)):
        parts = re.findall(r"([\d.]+) % " + pattern, said.text)
        if share is not None and len(parts) > at:
            yield share, sum(map(_number, parts[at]))


_SECTION = r"([\d.]+) % \(95 %: [\d.]+ to [\d.]+ %; n = [\d,]+ cases; by the AV's own motion"


@dataclass(frozen=True)
class Contradiction:
    """What must not stand side by side: how it is found ("" or False: it is not), and how it is forged into a page."""

    found: Callable[[Said], str | bool]
    forged: tuple[str, str]


CONTRADICTIONS: dict[str, Contradiction] = {
    "no flaw, and a careful driver would have prevented more than 10 %": Contradiction(
        lambda said: not said.flaw and said.careful > 10.0, (r"(None|In [\d.]+ %) of them", "In 24.2 % of them")
    ),
    "no flaw and nothing wrong in any case, and a careful driver would have prevented some": Contradiction(
        lambda said: not said.flaw and not said.wrong and said.careful > 0.0,
        (r"(None|In [\d.]+ %) of them", "In 0.9 % of them"),
    ),
    "no flaw and nothing wrong in any case, and a table with cases in which it did something wrong": Contradiction(
        lambda said: not said.flaw and not said.wrong and _wrong_rows(said) > 0,
        (r"nothing that is the AV&#39;s own doing", "it brakes hard for nothing"),
    ),
    "no flaw and nothing wrong in any case, and a case whose own doing is above 0": Contradiction(
        lambda said: (
            not said.flaw
            and not said.wrong
            and _some(said, lambda case: float(case.row.get("own doing", "0").split()[0]) > 0.0)
        ),
        (r'(data-label="own doing">)0\.00', r"\g<1>0.50"),
    ),
    "a flaw that made its crashes, and hardly any that a careful driver would have prevented": Contradiction(
        lambda said: bool(said.flaw) and said.careful < 0.5 * said.flaw_share,
        (r"In [\d.]+ % of them", "None of them"),
    ),
    "more that a careful driver would have prevented than cases in which it did something wrong": Contradiction(
        lambda said: (said.share(_SECTION) or 0.0) > 0.06 + 100.0 * _wrong_rows(said) / max(said.table(_DOING)[0], 1),
        (r"[\d.]+ %( \(95 %: [\d.]+ to [\d.]+ %; n = [\d,]+ cases; by the AV)", r"99.5 %\1"),
    ),
    "one share that a careful driver would have prevented above, another one below": Contradiction(
        lambda said: (
            "adversary caused; by" in said.text
            and said.share(_SECTION) is not None
            and said.share(_SECTION) != said.careful
        ),
        (r"In [\d.]+ % of them", "In 9.99 % of them"),
    ),
    "parts of a share that are not the share": Contradiction(
        lambda said: next((f"{a} {b}" for a, b in _parts(said) if abs(a - b) > 0.11), ""),
        (r"([\d.]+) % by leaving out", "41.0 % by leaving out"),
    ),
    "shares of a whole that are not the whole": Contradiction(
        _not_a_whole, (r"(nothing that is the AV&#39;s own doing</th><td class=\"number\">)\d+", r"\g<1>1")
    ),
    "of one case: a careful driver would have prevented it, and it was unavoidable": Contradiction(
        lambda said: _some(said, lambda case: _WOULD in case.words and "unavoidable" in case.words),
        (r"In hindsight, the AV could have avoided it[^\"]*", "In hindsight unavoidable."),
    ),
    "of one case: no careful driver would have prevented it, and it was the AV's own doing": Contradiction(
        lambda said: _some(said, lambda case: "No careful driver would" in case.words and _OWN in case.words),
        (r"A careful driver would have prevented it by braking", "No careful driver would have prevented it"),
    ),
    "of one case: own doing 1 in the table and not in the verdict, or the other way": Contradiction(
        lambda said: _some(
            said,
            lambda case: bool(case.row) and (float(case.row["own doing"].split()[0]) > 0.0) != (_OWN in case.verdict),
        ),
        (r'(data-label="own doing">)1\.00', r"\g<1>0.00"),
    ),
    "of one case: a careful driver in the table and not in the verdict, or the other way": Contradiction(
        lambda said: _some(
            said,
            lambda case: (
                bool(case.row)
                and case.row["what would have prevented it"].startswith("a careful driver,") != (_WOULD in case.verdict)
            ),
        ),
        (r"a careful driver, by [a-z ]+(</td>)", r"no careful driver\1"),
    ),
    "a lane change that nobody can see: a title that names one of less than 0.2 m": Contradiction(
        lambda said: _some(
            said,
            lambda case: any(
                pattern.match(case.title) is not None and moved < _VISIBLE_M
                for pattern, moved in zip((_AV_MOVES, _OTHER_MOVES), case.moved_m, strict=True)
            ),
        ),
        (r"\"title\":\"[^\"]*", '"title":"The AV cuts in'),
    ),
    "how often is not known, and it is": Contradiction(
        lambda said: "How often on a road? Not known" in said.text and "once in" in said.text,
        (r"they show how the AV can crash", "once in 5 miles"),
    ),
}
"""What contradicts what, in plain words."""


HIDDEN = {"strangers:BumperHugger", "strangers:HalfwayQuitter", "strangers:TwoOverBlind", "strangers:ClosingMisjudge"}
"""AVs whose flaw makes too few of such crashes to be named in 300: those are of others, who turn into the AV's side."""
CASES, MORE_CASES = 80, 300
IN_FEW = {"flawed-too-close", "strangers:GateCloser", "strangers:CutInPanic"}
"""AVs whose flaw makes 3 to 6 % of such crashes: 300 are enough to name it, 80 are not always."""


@pytest.fixture
def page_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, int], Path]:
    """Make the page of so many crashes of an AV."""
    monkeypatch.syspath_prepend(str(STRANGERS))
    monkeypatch.setenv("PYTHONPATH", str(STRANGERS))

    def made(av: str, cases: int) -> Path:
        place, whose = tmp_path / av.replace(":", "-"), AVS[av][0]
        if whose == NATURAL:
            cornerforge.rate(av=av, method="mc", max_tests=25 * cases, seed=3, out=place / "natural", threads=2)
        else:
            cornerforge.generate(policy=whose, av=av, cases=cases, seed=3, out=place / "library", threads=2)
        made = place / ("natural" if whose == NATURAL else "library")
        return Path(cornerforge.make_report(made, out=place / "page", avoidability="20").report)

    return made


def contradictions(said: Said) -> dict[str, str | bool]:
    return {words: found for words, one in CONTRADICTIONS.items() if (found := one.found(said))}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("av", AVS)
def test_a_page_says_what_is_wrong_and_does_not_contradict_itself(av: str, page_of: Callable[[str, int], Path]) -> None:
    """Flaws are named without knowing them; an AV without one is accused of none, but for chance."""
    said, wrong = Said(page_of(av, MORE_CASES if av in IN_FEW else CASES)), AVS[av][1]
    print(f"| {av} | {AVS[av][0]} | {said.flaw or 'nothing'}, {said.flaw_share:g} % | {said.careful:g} % | {wrong} |")
    assert contradictions(said) == {}
    if wrong == GOOD:
        assert said.flaw_share < 5.0
    elif av not in HIDDEN:
        assert said.flaw


@pytest.mark.full
def test_a_contradiction_that_is_forged_into_a_page_is_found(page_of: Callable[[str, int], Path]) -> None:
    pages = [page_of(av, CASES) for av in ("idm-mobil", "flawed-forgets")]
    for words, one in CONTRADICTIONS.items():
        forged = [page for page in pages if re.search(one.forged[0], page.read_text(encoding="utf-8"))]
        assert any(words in contradictions(Said(page, one.forged)) for page in forged), words
