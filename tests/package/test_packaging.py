"""What is built can be installed anywhere and renders there what the checkout renders."""

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

import mbinterval
from mbinterval.device.sources import kernel_root
from mbinterval.errors import DeviceError

ROOT = Path(__file__).parents[2]

SCENE = """
[camera]
position = [0, 0, 5]
look_at = [0, 0, 0]

[[objects]]
primitive = { kind = "box", size = [1, 1, 1] }
transform.keys = [
  { frame = 0, translation = [-1, 0, 0] },
  { frame = 2, translation = [1, 0.5, 0], euler = [30, 40, 0] },
]
"""


def run(*command, **options):
    """Run a command that must succeed, without this process's Python paths; its output."""
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(
        [str(part) for part in command],
        env=environment,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        **options,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def files_below(folder):
    """Relative names of the source files below ``folder``."""
    return {
        str(path.relative_to(folder))
        for path in folder.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


def make_package(folder, place):
    kernels = folder / place / "cl" / "analytic"
    kernels.mkdir(parents=True)
    (kernels / "paths.cl").touch()
    return folder / "mbinterval"


def test_kernels_are_found_inside_the_package_before_beside_it(tmp_path):
    package = make_package(tmp_path, "")
    assert kernel_root(package) == tmp_path / "cl"
    make_package(tmp_path, "mbinterval")
    assert kernel_root(package) == package / "cl"


def test_missing_kernels_are_a_device_error_that_names_both_places(tmp_path):
    (tmp_path / "cl").mkdir()
    with pytest.raises(DeviceError) as caught:
        kernel_root(tmp_path / "mbinterval")
    assert str(tmp_path / "mbinterval" / "cl") in str(caught.value)
    assert f"and {tmp_path / 'cl'}" in str(caught.value)


def test_kernels_of_this_checkout_are_found():
    assert kernel_root() == ROOT / "cl"


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Folder with an sdist, and a wheel that was built from it."""
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--outdir", folder, ROOT, cwd=folder)
    return folder


@pytest.fixture(scope="module")
def installed(built, tmp_path_factory):
    """Folder ``bin`` of a fresh environment that holds the wheel and what it asks for."""
    folder = tmp_path_factory.mktemp("fresh") / "venv"
    run(sys.executable, "-m", "venv", folder)
    (wheel,) = built.glob("*.whl")
    run(folder / "bin" / "python", "-m", "pip", "install", "--quiet", wheel, cwd=folder)
    return folder / "bin"


@pytest.mark.install
def test_the_wheel_holds_the_package_with_its_kernels(built):
    (wheel,) = built.glob("*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    expected = {f"mbinterval/{name}" for name in files_below(ROOT / "mbinterval")}
    expected |= {f"mbinterval/cl/{name}" for name in files_below(ROOT / "cl")}
    inside = {name for name in names if name.startswith("mbinterval/")}
    assert inside == expected
    assert "mbinterval/py.typed" in inside
    info = f"mbinterval-{mbinterval.__version__}.dist-info"
    assert {f"{info}/licenses/LICENSE", f"{info}/entry_points.txt"} <= names
    assert all(name.split("/")[0] in ("mbinterval", info) for name in names)


@pytest.mark.install
def test_the_sdist_holds_what_the_tests_and_the_readme_need(built):
    (sdist,) = built.glob("*.tar.gz")
    top = f"mbinterval-{mbinterval.__version__}/"
    with tarfile.open(sdist) as archive:
        names = {name.removeprefix(top) for name in archive.getnames()}
    for folder in ("mbinterval", "cl", "scenes", "tests"):
        assert {f"{folder}/{name}" for name in files_below(ROOT / folder)} <= names
    assert {"README.md", "CHANGELOG.md", "LICENSE", "pyproject.toml"} <= names


@pytest.mark.install
def test_the_wheel_in_an_empty_environment_renders_what_the_checkout_renders(installed, tmp_path):
    scenes, work = tmp_path / "scènes and more", tmp_path / "work"
    scenes.mkdir()
    work.mkdir()
    (scenes / "box.toml").write_text(SCENE)
    options = ["--width", "64", "--height", "48", "--frames", "1"]
    arguments = ["render", scenes / "box.toml", *options]
    run(installed / "mbinterval", *arguments, "-o", "wheel.exr,wheel.png", cwd=work)
    run(sys.executable, "-m", "mbinterval", *arguments, "-o", work / "checkout.exr", cwd=ROOT)
    assert {path.name for path in work.iterdir()} == {"wheel.exr", "wheel.png", "checkout.exr"}
    assert (work / "wheel.exr").read_bytes() == (work / "checkout.exr").read_bytes()
    film = mbinterval.Film.read(work / "wheel.exr")
    assert 0 < film.rgba[..., 3].mean() < 1


@pytest.mark.install
def test_the_installed_package_is_typed_and_lists_devices(installed, tmp_path):
    assert run(installed / "mbinterval", "--version") == f"mbinterval {mbinterval.__version__}\n"
    assert "compute units" in run(installed / "mbinterval", "devices", cwd=tmp_path)
    code = "import mbinterval, pathlib; print(pathlib.Path(mbinterval.__file__).parent)"
    package = Path(run(installed / "python", "-c", code, cwd=tmp_path).strip())
    assert package.is_relative_to(installed.parent)
    assert (package / "py.typed").is_file()


@pytest.mark.install
@pytest.mark.nightly  # as the environment of the tests is one
def test_an_editable_install_uses_the_kernels_of_the_checkout(tmp_path):
    checkout = tmp_path / "checkout"
    for name in ("mbinterval", "cl"):
        shutil.copytree(ROOT / name, checkout / name)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, checkout / name)
    run(sys.executable, "-m", "venv", tmp_path / "venv")
    python = tmp_path / "venv" / "bin" / "python"
    run(python, "-m", "pip", "install", "--quiet", "--no-deps", "-e", checkout, cwd=tmp_path)
    code = "from mbinterval.device.sources import kernel_root; print(kernel_root())"
    assert run(python, "-c", code, cwd=tmp_path).strip() == str(checkout / "cl")
