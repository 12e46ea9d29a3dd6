"""Run the two published studies and put their pages and tables in `reports/`.

A user's own runs go to `reports/` too; .gitignore keeps everything out but tables and pages of
these two. Published folders have no posteriors and meshes, their drawings one decimal, pictures
in them 64 colours, and each page ends with the commit that made it.

    uv run python docs/publish_reports.py
"""

import base64
import io
import re
import shutil
import subprocess
import sys
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "reports"
RUNS = ROOT / ".cache" / "published"
COMMAND = "uv run python docs/publish_reports.py"
STUDIES = ("gelatin_actuator", "treloar")
PUBLISHED = ("*.csv", "verdict.json", "run.json")
DRAWN = re.compile(r'((?<=\s)(?:d|x|y|x1|x2|y1|y2|points)=")([^"]*)"')
PICTURE = re.compile(r"data:image/png;base64,([^\"]*)")
COLOURS = 64
BROWSER = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--hide-scrollbars",
    "--window-size=1200,1400",
)
SHOWN = (235, 52, 1200, 1275)  # left, top, right, bottom: the verdict and the first figure
LARGEST_BYTES = 1_250_000


def main() -> None:
    """Publish every report."""
    describe = ["git", "describe", "--always", "--dirty", "--abbrev=8", "--exclude=*"]
    done = subprocess.run(describe, cwd=ROOT, capture_output=True, text=True, check=True)
    line = f"Made by commit {done.stdout.strip()} with <code>{COMMAND}</code>."
    for name in STUDIES:
        run = RUNS / name
        command = [sys.executable, "-m", "bayesdeg", "run", f"studies/{name}", "--out", str(run)]
        subprocess.run(command, cwd=ROOT, check=True)
        publish(run, TARGET / name, line)
    photograph(TARGET / STUDIES[0] / "index.html", ROOT / "docs" / "_static" / "report.png")


def photograph(page: Path, picture: Path) -> None:
    """Make the picture of a report on the first page, if there is a browser."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        print("no chromium: the picture of the report stays as it was")
        return
    command = [browser, *BROWSER, f"--screenshot={picture}", page.as_uri()]
    subprocess.run(command, check=True, capture_output=True)
    shown = Image.open(picture).convert("RGB").crop(SHOWN)
    small = shown.resize((shown.width * 4 // 5, shown.height * 4 // 5), Image.Resampling.LANCZOS)
    small.quantize(128, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(
        picture, optimize=True
    )


def publish(run: Path, target: Path, line: str) -> None:
    """Copy the page, made smaller and ending with a line, and the tables that it links."""
    shutil.rmtree(target, ignore_errors=True)
    target.mkdir(parents=True)
    for pattern in PUBLISHED:
        for file in sorted(run.glob(pattern)):
            shutil.copy(file, target / file.name)
    page = smaller((run / "index.html").read_text(encoding="utf-8"))
    page = page.replace("</body>", f"<footer>{line}</footer>\n</body>")
    (target / "index.html").write_text(page, encoding="utf-8")
    size = len(page.encode())
    print(f"{target.relative_to(ROOT)}/index.html: {size / 1e6:.2f} MB")
    if size > LARGEST_BYTES:
        raise SystemExit(f"{target.name}: the page is larger than {LARGEST_BYTES / 1e6:g} MB")


def smaller(page: str) -> str:
    """Return a page whose drawings have fewer decimals and whose pictures fewer colours."""
    page = DRAWN.sub(lambda found: f'{found[1]}{_shortened(found[2])}"', page)
    page = PICTURE.sub(lambda found: f"data:image/png;base64,{_repainted(found[1])}", page)
    page = re.sub(r"<svg.*?</svg>", lambda found: _terse(found[0], page), page, flags=re.DOTALL)
    return re.sub(r"\n\s+", "\n", page)


def _terse(drawing: str, page: str) -> str:
    """Return a drawing without spaces in its styles and without ids that nothing points to."""
    used = set(re.findall(r"#([\w-]+)", page))
    drawing = re.sub(
        r'style="([^"]*)"', lambda found: f'style="{re.sub(r"([:;]) ", r"\1", found[1])}"', drawing
    )
    return re.sub(r' id="([^"]*)"', lambda found: found[0] if found[1] in used else "", drawing)


def _shortened(numbers: str) -> str:
    return " ".join(re.sub(r"(\d\.\d)\d+", r"\1", numbers).split())


def _repainted(encoded: str) -> str:
    picture = Image.open(io.BytesIO(base64.b64decode(encoded)))
    written = io.BytesIO()
    few = picture.convert("RGBA").quantize(COLOURS, method=Image.Quantize.FASTOCTREE)
    few.save(written, "PNG", optimize=True)
    return base64.b64encode(written.getvalue()).decode()


if __name__ == "__main__":
    main()
