"""Starts the real programs for the integration tests: on loopback, on ports of the system's choice, with data in
temporary folders. Ends only what it started, by process id."""

import contextlib
import http.client
import json
import os
import pathlib
import shutil
import signal
import struct
import subprocess
import tempfile
import time
import unittest
import zlib

BIN = pathlib.Path(os.environ["DEPTHTWEEN_BIN"])
SOURCE = pathlib.Path(__file__).resolve().parents[2]

# How long anything may take before a test gives up: generous, because the machine may be busy. Nothing waits this long
# when it works.
PATIENCE_S = 120

EXIT_OK, EXIT_FAILED, EXIT_USAGE, EXIT_UNREACHABLE = 0, 1, 2, 3
EXIT_INPUT_REJECTED, EXIT_JOB_FAILED, EXIT_JOB_CANCELLED, EXIT_NOT_FINISHED = 4, 5, 6, 7


def wait_for(what, condition, patience_s=PATIENCE_S):
    """Waits until condition() is true and returns what it returned."""
    deadline = time.monotonic() + patience_s
    while time.monotonic() < deadline:
        result = condition()
        if result:
            return result
        time.sleep(0.02)
    raise AssertionError(f"waited {patience_s} s in vain for: {what}")


class Process:
    """A process seen through /proc: known by id and start time, so that a later one of the same id is not taken for it."""

    def __init__(self, pid):
        self.pid = pid
        self._start = self._stat()[19]

    def _stat(self):
        text = pathlib.Path(f"/proc/{self.pid}/stat").read_text()
        return text[text.rindex(")") + 2:].split()  # from field 3 (state) on

    def lives(self):
        """A zombie is gone: it holds neither processor nor memory."""
        with contextlib.suppress(OSError):
            fields = self._stat()
            return fields[19] == self._start and fields[0] not in "ZX"
        return False

    def parent(self):
        return int(self._stat()[1])

    def state(self):
        """One letter, such as "T" of one that is suspended."""
        return self._stat()[0]

    def name(self):
        """What it calls itself, at most 15 characters."""
        return pathlib.Path(f"/proc/{self.pid}/comm").read_text().strip()

    def cpu_seconds(self):
        fields = self._stat()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def children_of(pid):
    found = []
    for entry in pathlib.Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError):
                process = Process(int(entry.name))
                if process.parent() == pid and process.lives():
                    found.append(process)
    return found


class Server:
    """depthtween-server on a data folder; may be killed, and started again on the same port."""

    def __init__(self, data_dir, workers=1, options=(), http=False):
        self.data_dir = pathlib.Path(data_dir)
        self.workers = workers
        self.options = list(options)
        self.port = 0
        self.with_http = http
        self.http_port = 0
        self.process = None
        self._scratch = tempfile.TemporaryDirectory(prefix="depthtween_server_")
        self.log = pathlib.Path(self._scratch.name) / "log"

    def __enter__(self):
        try:
            self.start()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        if self.process is not None and self.process.poll() is None:
            self.kill()
        self._scratch.cleanup()

    @property
    def address(self):
        return f"127.0.0.1:{self.port}"

    def start(self):
        port_file = pathlib.Path(self._scratch.name) / "port"
        port_file.unlink(missing_ok=True)
        command = [BIN / "depthtween-server", "serve", "--data-dir", self.data_dir, "--listen", self.address,
                   "--port-file", port_file, "--workers", str(self.workers), "--threads", "1", *self.options]
        http_port_file = pathlib.Path(self._scratch.name) / "http_port"
        http_port_file.unlink(missing_ok=True)
        if self.with_http:
            command += ["--http-listen", f"127.0.0.1:{self.http_port}", "--http-port-file", http_port_file]
        with open(self.log, "ab") as log:
            self.process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log)

        def ready():
            if self.process.poll() is not None:
                raise AssertionError(f"the server ended with {self.process.returncode}:\n{self.log_text()}")
            files = [port_file] + ([http_port_file] if self.with_http else [])
            return all(file.exists() and file.read_text().strip() for file in files)

        wait_for("the server to be ready", ready)
        self.port = int(port_file.read_text())
        if self.with_http:
            self.http_port = int(http_port_file.read_text())

    def kill(self):
        self.process.kill()
        self.process.wait()

    def stop(self):
        """SIGTERM. Returns the exit code."""
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(timeout=PATIENCE_S)

    def tasks(self):
        """The child processes that are computing."""
        return [process for process in children_of(self.process.pid) if not self._is_host(process)]

    @staticmethod
    def _is_host(process):
        """Whether it is the process that forks the others; one that has just ended is nothing of interest either."""
        try:
            return process.name() == "task-host"
        except OSError:
            return True

    def log_text(self):
        return self.log.read_text(errors="replace")

    def is_serving(self):
        return run("depthtween-server", "healthcheck", "--server", self.address).returncode == 0

    @property
    def http_address(self):
        return f"http://127.0.0.1:{self.http_port}"

    def http(self, method, path, body=None, headers=None):
        """One call over HTTP. Returns the status, and the answer read as JSON."""
        connection = http.client.HTTPConnection("127.0.0.1", self.http_port, timeout=PATIENCE_S)
        with contextlib.closing(connection):
            data = None if body is None else json.dumps(body)
            content = {} if data is None else {"Content-Type": "application/json"}
            connection.request(method, path, data, {**content, **(headers or {})})
            response = connection.getresponse()
            return response.status, json.loads(response.read())

    def client(self, command, *arguments, patience_s=60):
        """Runs depthtween to its end."""
        return run("depthtween", command, *arguments, "--server", self.address, "--patience", str(patience_s))

    def client_json(self, command, *arguments):
        result = self.client(command, *arguments, "--json")
        if result.returncode != 0:
            raise AssertionError(f"{result.args} ended with {result.returncode}:\n{result.stderr}")
        return json.loads(result.stdout)

    def start_client(self, command, *arguments, server=None):
        """Starts depthtween and returns at once."""
        return subprocess.Popen([BIN / "depthtween", command, *arguments, "--server", server or self.address],
                                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def job(self, name):
        return self.client_json("status", name)

    def wait_for_progress(self, name, condition, what):
        """Waits until condition(job) is true; a job that ends first is an error."""

        def reached():
            job = self.job(name)
            if condition(job):
                return job
            if job["state"] in ("STATE_SUCCEEDED", "STATE_FAILED", "STATE_CANCELLED"):
                raise AssertionError(f"{name} ended before {what}: {job}")
            return None

        return wait_for(what, reached)


def run(program, *arguments):
    return subprocess.run([BIN / program, *map(str, arguments)], stdin=subprocess.DEVNULL, capture_output=True,
                          text=True, timeout=2 * PATIENCE_S)


def check(result):
    if result.returncode != 0:
        raise AssertionError(f"{result.args} ended with {result.returncode}:\n{result.stdout}{result.stderr}")
    return result


def synth(folder, frames, scene="kick", size="160x120"):
    """A recording of a scene of the library: 240 fps colour, 30 fps depth."""
    check(run("depthtween-core", "synth", scene, "-o", folder, "--frames", frames, "--size", size, "--no-truth"))


def upsample(sequence, out, *options):
    check(run("depthtween-core", "upsample", sequence, "-o", out, *options))


def png(width, height, bits=16, colour=False, value=1000):
    """A PNG of one colour: grey of 8 or 16 bits, or RGB of 8."""
    pixel = bytes([value & 255] * 3) if colour else value.to_bytes(bits // 8, "big")
    return png_of(width, height, bits, 2 if colour else 0, pixel * (width * height))


def png_of(width, height, bits, colour_type, pixels):
    """A PNG of these pixels, row by row."""
    stride = len(pixels) // height
    rows = b"".join(b"\0" + pixels[y * stride:(y + 1) * stride] for y in range(height))
    return (png_header(width, height, bits, colour_type) + png_chunk(b"IDAT", zlib.compress(rows, 1)) +
            png_chunk(b"IEND", b""))


def png_header(width, height, bits, colour_type):
    return b"\x89PNG\r\n\x1a\n" + png_chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, colour_type, 0, 0, 0))


def png_chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


class Recording:
    """A small recording, one byte string a file, to be spoilt by a test before it is written."""

    def __init__(self, width=64, height=48, color_frames=3):
        self.width, self.height = width, height
        self.camera = {"width": width, "height": height, "fx": 60.0, "fy": 60.0, "cx": width / 2, "cy": height / 2,
                       "depth_scale": 1000.0}
        self.color_times = [0.02 * i for i in range(color_frames)]
        self.depth_times = [0.0, self.color_times[-1]]
        self.files = {}
        for i in range(len(self.color_times)):
            self.files[f"rgb/{i:06}.png"] = png(width, height, bits=8, colour=True, value=90 + i)
        for i in range(len(self.depth_times)):
            self.files[f"depth/{i:06}.png"] = png(width, height, value=1500)

    def write(self, folder):
        files = {
            "camera.json": json.dumps(self.camera).encode(),
            "rgb.txt": self._list("rgb", self.color_times),
            "depth.txt": self._list("depth", self.depth_times),
            **self.files,
        }
        for name, data in files.items():
            path = pathlib.Path(folder) / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)

    @staticmethod
    def _list(kind, times):
        return "".join(f"{t:.6f} {kind}/{i:06}.png\n" for i, t in enumerate(times)).encode()


def result_files(folder):
    """Every file of a result but the report, which tells how long things took."""
    folder = pathlib.Path(folder)
    return {str(path.relative_to(folder)): path.read_bytes()
            for path in sorted(folder.rglob("*")) if path.is_file() and path.name != "report.json"}


class IntegrationTest(unittest.TestCase):
    """Gives every test a folder of its own, self.folder."""

    maxDiff = 2000

    def setUp(self):
        folder = tempfile.mkdtemp(prefix="depthtween_integration_")
        self.addCleanup(shutil.rmtree, folder, ignore_errors=True)
        self.folder = pathlib.Path(folder)

    def assert_names_nothing_of(self, server, out):
        """No file of a result tells where the server keeps its data."""
        for path in pathlib.Path(out).rglob("*"):
            if path.is_file():
                self.assertNotIn(str(server.data_dir).encode(), path.read_bytes(), path)

    def assert_same_result(self, out, reference):
        ours, theirs = result_files(out), result_files(reference)
        self.assertEqual(sorted(ours), sorted(theirs))
        self.assertEqual([name for name in ours if ours[name] != theirs[name]], [], "files that differ")


def main():
    unittest.main(verbosity=2)
