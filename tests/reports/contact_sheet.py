"""A picture of every model in a folder, a little way into its animation.

    python tests/reports/contact_sheet.py FOLDER SHEET.png [--columns 5]

Every glTF, USD, OBJ and PLY file below the folder is loaded and rendered as `mbinterval render
MODEL` would, 0.37 seconds into its first clip. Of each folder one model is taken. What can't be
rendered has its reason printed, and the sheet is made of the rest.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

import mbinterval as mb

SIZE = (240, 180)
SUFFIXES = (".usd", ".usda", ".usdc", ".usdz", ".gltf", ".glb", ".obj", ".ply")
SECONDS = 0.37


def models(folder: Path) -> list[Path]:
    """One file of each folder of models, the first of ``SUFFIXES`` that there is."""
    found: list[Path] = []
    for inner in sorted(path for path in folder.iterdir() if path.is_dir()):
        files = [path for path in inner.iterdir() if path.suffix in SUFFIXES]
        found += sorted(files, key=lambda path: (SUFFIXES.index(path.suffix), path.name))[:1]
    return found


def picture(path: Path) -> tuple[Image.Image, str]:
    """The model's picture, and what had to be assumed."""
    scene = mb.load(path)
    frame = round(SECONDS * scene.fps)
    film = mb.render(
        scene, frame=frame, width=SIZE[0], height=SIZE[1], settings=mb.Settings(samples=16)
    )
    linear = np.clip(film.rgba[..., :3], 0.0, 1.0)
    shown = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    image = Image.fromarray(np.rint(shown * 255).astype(np.uint8))
    ImageDraw.Draw(image).text((4, 2), path.parent.name, fill="white")
    return image, "; ".join(film.notes)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("sheet", type=Path)
    parser.add_argument("--columns", type=int, default=5)
    options = parser.parse_args()
    pictures = []
    for path in models(options.folder):
        try:
            image, notes = picture(path)
        except mb.MbintervalError as error:
            print(f"{path.name}: not rendered: {error}")
            continue
        print(f"{path.name}: {notes}")
        pictures.append(image)
    rows = -(-len(pictures) // options.columns)
    sheet = Image.new("RGB", (SIZE[0] * options.columns, SIZE[1] * rows), "white")
    for index, image in enumerate(pictures):
        row, column = divmod(index, options.columns)
        sheet.paste(image, (SIZE[0] * column, SIZE[1] * row))
    sheet.save(options.sheet, optimize=True)


if __name__ == "__main__":
    main()
