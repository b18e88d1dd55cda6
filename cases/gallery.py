"""The case index of the manual, with thumbnails, by one command.

    python cases/gallery.py              thumbnails and index from the pictures that there are
    python cases/gallery.py --missing    run cases without a picture first
    python cases/gallery.py --draw       run all cases and draw all pictures anew
    python cases/gallery.py --draw excavator wheel    these only

Pictures stand beside the scenes: `picture.png` and `history.png` of `scene.toml`, `NAME.png` and
`NAME.history.png` of `NAME.toml`; `modes.png` of a scene with bodies alone.
The index is `flexmb help cases`.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

CASES = Path(__file__).resolve().parent
PAGE = CASES.parent / "flexmb" / "manual" / "cases.md"
THUMBNAILS = PAGE.parent / "pictures"
SIZE, COLOURS = (240, 160), 64
PALETTE = 200  # colours of a picture
HEAD = """# Cases

Scenes with known answers: what they show, a picture of each, and how to run them.

Each case is a folder of `cases/` in the sources with one or more scenes, their known answers
(`[[check]]`) and, where these are no formula, `exact.py`, which uses nothing of flexmb.
`flexmb run cases/quick_return/scene.toml` runs one and compares it, `flexmb check-all cases` all,
and `flexmb compare` models of one object ([one object, several models](textbook.md)).
`python cases/gallery.py` makes this index.

| case | what it shows | scenes | known answers |
|---|---|---|---|
"""


def scenes(folder: Path) -> list[Path]:
    """The scenes of a case, the main one first."""
    return sorted(folder.glob("*.toml"), key=lambda path: (path.stem != "scene", path.stem))


def pictures(scene: Path) -> tuple[Path, Path]:
    """Where the picture and the history of a scene stand."""
    if scene.stem == "scene":
        return scene.parent / "picture.png", scene.parent / "history.png"
    return scene.with_suffix(".png"), scene.parent / f"{scene.stem}.history.png"


def draw(scene: Path) -> None:
    """Run a scene and bring its pictures beside it."""
    import flexmb

    data = tomllib.loads(scene.read_text(encoding="utf-8"))
    picture, history = pictures(scene)
    with tempfile.TemporaryDirectory() as folder:
        if {"dynamics", "kinematics", "statics"} & data.keys():
            report = flexmb.run_scene(scene, output=folder)
            drawn = {report.picture: picture, report.history: history}
        elif "part" in data:
            drawn = {flexmb.run_part(scene, output=folder).pictures[0]: picture}
        else:  # bodies alone: the modes of the first
            from flexmb.workflow.reduction import reduce_scene

            body = reduce_scene(scene, output=Path(folder)).bodies[0]
            modes = flexmb.render_modes(body.path, output=Path(folder) / "modes.png")
            drawn = {modes: picture.with_name(picture.name.replace("picture", "modes"))}
        for source, target in drawn.items():
            if source is not None:
                save_small(source, target)


def save_small(source: Path, target: Path) -> None:
    """Copy a picture with a palette, which takes a third of the room and looks the same."""
    from PIL import Image

    image = Image.open(source).convert("RGB").quantize(PALETTE, dither=Image.Dither.NONE)
    image.save(target, optimize=True)


def picture_of(folder: Path) -> Path | None:
    """The picture of a case that shows most of it."""
    names = ("picture.png", "modes.png", "stress.png", "history.png")
    return next((folder / name for name in names if (folder / name).is_file()), None)


def thumbnail(folder: Path) -> str:
    """Make the thumbnail of a case; its name."""
    from PIL import Image

    source = picture_of(folder)
    if source is None:
        return ""
    image = Image.open(source).convert("RGB")
    if source.name == "picture.png":
        image = image.crop(_machine(image))
    image.thumbnail(SIZE)
    name = f"case-{folder.name}.png"
    image.quantize(COLOURS).save(THUMBNAILS / name, optimize=True)
    return name


def _machine(image: Any) -> tuple[int, int, int, int]:
    """The part of a picture that is no title, no triad and no margin."""
    from PIL import Image, ImageChops

    width, height = image.size
    plain = Image.new("RGB", image.size, image.getpixel((width // 2, height - 2)))
    gap = ImageChops.difference(image, plain).convert("L").point(lambda x: 255 * (x > 12))
    gap.paste(0, (0, 0, width, height // 9))
    gap.paste(0, (0, 3 * height // 4, width // 8, height))
    left, top, right, bottom = gap.getbbox() or (0, 0, width, height)
    edge = width // 50
    return (
        max(0, left - edge), max(0, top - edge),
        min(width, right + edge), min(height, bottom + edge),
    )  # fmt: skip


def first_sentence(scene: Path) -> str:
    """The first sentence of the comment at the head of a scene, else its title."""
    text = scene.read_text(encoding="utf-8")
    head = re.match(r"(?:#.*\n)+", text)
    if head is None:
        return str(tomllib.loads(text).get("title", ""))
    words = " ".join(line.strip("# ") for line in head[0].splitlines())
    return re.split(r"(?<=[.?:])\s", words, maxsplit=1)[0].rstrip(":")


def index() -> str:
    """The page."""
    rows = []
    for folder in sorted(path.parent for path in CASES.glob("*/scene.toml")):
        own = scenes(folder)
        answers = [
            len(tomllib.loads(path.read_text(encoding="utf-8")).get("check", ())) for path in own
        ]
        shown = THUMBNAILS / f"case-{folder.name}.png"
        image = f"![{folder.name}](pictures/{shown.name})" if shown.is_file() else ""
        what = first_sentence(own[0]).replace("|", "\\|")
        names = ", ".join(f"`{path.stem}`" for path in own)
        rows.append(f"| `{folder.name}` {image} | {what} | {names} | {sum(answers)} |")
    return HEAD + "\n".join(rows) + "\n"


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("case", nargs="*", help="cases to draw; all by default")
    parser.add_argument("--draw", action="store_true", help="run and draw them anew")
    parser.add_argument("--missing", action="store_true", help="run those without a picture")
    options = parser.parse_args()
    folders = sorted(path.parent for path in CASES.glob("*/scene.toml"))
    unknown = set(options.case) - {folder.name for folder in folders}
    if unknown:
        parser.error(f"no such case: {', '.join(sorted(unknown))}")
    for folder in folders:
        if options.case and folder.name not in options.case:
            continue
        for scene in scenes(folder):
            lacks = not pictures(scene)[0].is_file() and (
                scene.stem != "scene" or picture_of(folder) is None
                or picture_of(folder).name == "history.png"
            )  # fmt: skip
            if options.draw or (options.missing and lacks):
                sys.stderr.write(f"{scene.relative_to(CASES)}\n")
                draw(scene)
        thumbnail(folder)
    PAGE.write_text(index(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
