"""Several devices share frames out; one that fails is told of, and its frames are redone.

PoCL makes two devices of one CPU where POCL_DEVICES asks for it, so each batch is a process of its
own; elsewhere two contexts stand for two devices. Failures are injected where work is given to a
device's queue.
"""

from __future__ import annotations

import json
import signal

import pytest
from support.batch_processes import finish, images, start

from mbinterval import cli

TWO = """
import os
os.environ["POCL_DEVICES"] = "basic pthread"
import mbinterval
from mbinterval.device import choose
from mbinterval.device.runtime import Runtime

class Named:
    def __init__(self, device, name):
        self.device, self.name = device, name
    def __getattr__(self, name):
        return getattr(self.device, name)

class Context(Runtime):
    name = property(lambda self: self.device.name)
    def __init__(self, device, name):
        super().__init__(device)
        self.device = Named(device, name)
    def _build(self, *arguments):
        named, self.device = self.device, self.device.device
        try:
            return super()._build(*arguments)
        finally:
            self.device = named

if len(mbinterval.devices()) < 2:  # another implementation than PoCL: two contexts
    device = choose.choose_device()
    two = tuple(Context(device, name) for name in ("basic-", "pthread-"))
    choose.choose_devices = lambda wanted: two
"""

FAILING = """
import threading
from mbinterval.device.runtime import Runtime
names = {names!r}
count = dict.fromkeys(names, 0)
def run(self, kernel, *arguments, real=Runtime.run):
    name = next((n for n in names if n in self.device.name), None)
    if name is not None and kernel.name == "tile":
        count[name] += 1
        if {after} < count[name] <= {until}:
            raise {error}
    return real(self, kernel, *arguments)
Runtime.run = run
from mbinterval.errors import CapacityError, DeviceError, SceneError
"""
LOST = 'DeviceError("kernel tile: the device failed: OUT_OF_RESOURCES")'


def failing(*names, after=1, until=999, error=LOST):
    return TWO + FAILING.format(names=names, after=after, until=until, error=error)


def frames_by_device(folder):
    lines = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    done = [line for line in lines if line.get("status") == "rendered"]
    return [(line["frame"], line["device"].split("-")[0]) for line in done]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("one")
    assert finish(start(folder))[0] == 0
    return images(folder)


@pytest.mark.parametrize("wanted", ["all", "0,1", "basic, pthread"])
def test_frames_are_shared_out_and_are_those_of_one_device(tmp_path, undisturbed, wanted):
    code, said = finish(start(tmp_path, "--device", wanted, "--log", "log.jsonl", before=TWO))
    assert code == 0, said
    assert images(tmp_path) == undisturbed
    found = frames_by_device(tmp_path)
    assert sorted(frame for frame, _ in found) == [1, 2, 3, 4, 5, 6]
    assert {device for _, device in found} == {"basic", "pthread"}


def test_a_device_that_fails_is_told_of_and_another_one_renders_its_frames(tmp_path, undisturbed):
    before = failing("basic", after=1)
    code, said = finish(start(tmp_path, "--device", "all", "--log", "log.jsonl", before=before))
    assert code == 0, said
    assert images(tmp_path) == undisturbed
    assert [device for _, device in frames_by_device(tmp_path)].count("basic") <= 1
    (told,) = (line for line in said.splitlines() if "OUT_OF_RESOURCES" in line)
    assert "basic" in told
    assert told.endswith("another one renders it and what was left to this one")


def test_where_all_devices_fail_the_job_ends_with_the_error(tmp_path, undisturbed):
    before = failing("basic", "pthread", after=1)
    code, said = finish(start(tmp_path, "--device", "all", "--log", "log.jsonl", before=before))
    assert code == 4
    assert "Traceback" not in said
    assert said.count("error: ") == 1
    found = images(tmp_path)
    assert all(undisturbed[name] == data for name, data in found.items())
    assert len(found) <= 4
    failed, end = (
        json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()[-2:]
    )
    assert (failed["status"], failed["exit"], end["exit"]) == ("failed", 4, 4)
    assert finish(start(tmp_path))[0] == 0
    assert images(tmp_path) == undisturbed


def test_a_frame_without_room_on_one_device_goes_to_the_other_and_the_device_goes_on(
    tmp_path, undisturbed
):
    before = failing("basic", after=0, until=2, error='CapacityError("no room")')
    code, said = finish(start(tmp_path, "--device", "all", "--log", "log.jsonl", before=before))
    assert code == 0, said
    assert said.count("no room; another one renders it\n") == 2
    assert images(tmp_path) == undisturbed


def test_a_scene_that_is_wrong_ends_the_job_on_all_devices(tmp_path):
    before = failing("basic", "pthread", after=1, error='SceneError("the mesh is wrong")')
    code, said = finish(start(tmp_path, "--device", "all", before=before))
    assert code == 3
    assert said.count("the mesh is wrong") == 1


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_stopped_at_any_moment_it_leaves_whole_frames(tmp_path, undisturbed, number, code):
    process = start(tmp_path, "--device", "all", "--width", "640", "--height", "480", before=TWO)
    process.stderr.readline()
    process.send_signal(number)
    ended, said = finish(process)
    assert ended == code
    assert "Traceback" not in said
    assert len(images(tmp_path)) in (2, 4)
    assert not list(tmp_path.glob(".*"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--device", "all", "--memory", "2G"), "--memory is for one device"),
        (("--device", "0,99"), "device 99: there"),
        (("--parts", "2"), "--parts goes with --dask"),
        (("--dask", "tcp://127.0.0.1:9", "--threads", "2"), "--threads is for this machine"),
        (("--dask", "tcp://127.0.0.1:9", "--device", "0,1"), "start a worker for each"),
    ],
)
def test_what_does_not_go_together_is_said_before_any_work(
    tmp_path, monkeypatch, capsys, arguments, message
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MBINTERVAL_THREADS", "1")  # so that what --threads sets goes afterwards
    monkeypatch.delenv("MBINTERVAL_THREADS")
    (tmp_path / "s.json").write_text("{}")
    assert cli.main(["render", "s.json", "-o", "a.exr", *arguments]) in (2, 4)
    assert message in capsys.readouterr().err
    assert not list(tmp_path.glob("a.*"))
