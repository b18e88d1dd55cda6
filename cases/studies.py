"""What accuracy costs in six cases: their studies, tables and pictures, by one command.

    python cases/studies.py                 run what is missing, write page and table
    python cases/studies.py --fresh servo   run the study of this case anew

Studies stand in the scenes (`[study]`), runs in `out/<case>/study`, where finished ones are used
again; tables and pictures in `flexmb help studies`, a line of each in README.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import Any

CASES = Path(__file__).resolve().parent
ROOT = CASES.parent
PAGE = ROOT / "flexmb" / "manual" / "studies.md"
PICTURES = PAGE.parent / "pictures"
BEGIN, END = "<!-- studies: begin -->", "<!-- studies: end -->"
WHY = {
    "rigid_slider_crank": "The driver fixes the motion, so positions are exact whatever is "
    "asked for; what a digit costs is told by accelerations, reactions "
    "and the energy balance.",
    "slider_crank": "Above 1e-4 the steps decide, below it the modes: without vibration "
    "modes the reactions stay wrong however small the tolerance. "
    "At 1e-4 a run misses its request and is repeated, so that it "
    "costs twice as much as one at 1e-5.",
    "andrews": "A smooth, fast rigid mechanism: methods of high order pay little for "
    "a digit, one of order two pays for it in steps.",
    "flexible_four_bar": "What the model leaves out costs more accuracy than any tolerance: a "
    "rigid coupler does not bow, a quasi-static one does not ring.",
    "bowling_ball": "Where sliding ends the friction force jumps, and steps end there; "
    "before and after it the stiff contact rules the steps.",
    "servo": "The controller is part of the equations, so that the loop costs no "
    "accuracy; a smooth motion makes digits cheap for methods of high "
    "order.",
}  # fmt: skip


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("case", nargs="*", help="cases whose studies to run; all by default")
    parser.add_argument("--fresh", action="store_true", help="run them anew")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each setting")
    options = parser.parse_args()
    unknown = set(options.case) - set(WHY)
    if unknown:
        parser.error(f"no study of: {', '.join(sorted(unknown))}; there are {', '.join(WHY)}")
    again = set(options.case or WHY) if options.fresh else set()
    studies = {name: run(name, name in again, options.repeats) for name in WHY}
    PAGE.write_text(page(studies), encoding="utf-8")
    readme = ROOT / "README.md"
    text = readme.read_text(encoding="utf-8")
    part = re.compile(f"{BEGIN}.*?{END}", re.DOTALL)
    table = "\n".join([BEGIN, *summary_table(studies), END])
    readme.write_text(part.sub(lambda _: table, text), encoding="utf-8")
    return 0


def run(name: str, fresh: bool, repeats: int) -> Any:
    """The study of a case; its picture goes to the manual."""
    import flexmb

    sys.stderr.write(f"{name}\n")
    study = flexmb.study(
        CASES / name / "scene.toml", output=ROOT / "out" / name / "study", workers=1, fresh=fresh,
        repeats=repeats,
    )  # fmt: skip
    study.save()
    sys.path.insert(0, str(CASES))
    from gallery import save_small

    save_small(study.folder / "work_precision.png", PICTURES / f"study-{name}.png")
    return study


def summary_table(studies: dict[str, Any]) -> list[str]:
    """The cheapest setting of each case that meets 1 %, and what a digit costs."""
    from flexmb.studies.accuracy.report import cost_of_a_digit
    from flexmb.studies.study_settings import label

    lines = [
        "| case | cheapest within 1 % (positions; reactions) | CPU s | ten times less error |",
        "|---|---|---:|---:|",
    ]
    for name, study in studies.items():
        shown = [q for q in ("positions", "reactions") if q in study.compared]
        rows = [study.cheapest(quantity) for quantity in shown]
        words = dict.fromkeys(label(row.values) if row else "none tried" for row in rows)
        times = dict.fromkeys(f"{row.time:.2g}" if row else "-" for row in rows)
        costs = [cost_of_a_digit(study, q) for q in ("reactions", "velocities", "positions")]
        cost = next((f"x {factor:.2g}" for factor in costs if factor is not None), "-")
        lines.append(f"| `{name}` | {'; '.join(words)} | {'; '.join(times)} | {cost} |")
    return lines


def page(studies: dict[str, Any]) -> str:
    """The page of the manual."""
    head = """# Six studies

What accuracy costs in six machines, rigid and flexible, with contact and control.

Each case has a `[study]`; `flexmb study cases/servo/scene.toml` runs one, `python
cases/studies.py` all of them and makes this page. Times are processor times of the integration;
ringed is the cheapest setting that meets 1 %. How a study works stands in
[accuracy](accuracy.md#what-accuracy-costs), what the error of one scene consists of in [error
budgets](budget.md).

"""
    parts = [head, "\n".join(summary_table(studies)), "\n"]
    for name, study in studies.items():
        text = study.markdown().split("\n", 2)[2]
        table, _, sentences = text.partition("\nErrors: ")
        notes = [s for s in sentences.splitlines() if s.startswith("- ")][:-1]
        source = str(CASES / name / "scene.toml")
        words = "\n".join(s.replace(source, f"cases/{name}/scene.toml") for s in notes)
        picture = f"![Error against processor time: {study.title}](pictures/study-{name}.png)"
        parts.append(
            f"\n## {study.title}\n\n{WHY[name]}\n\n{picture}\n\n{table.strip()}\n\n{words}\n"
        )
    return "".join(parts)


if __name__ == "__main__":
    sys.exit(main())
