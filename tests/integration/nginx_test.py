"""deploy/nginx/depthtween.conf in front of the real server: what goes through it must be what goes to the server itself,
and a flood of HTTP/2 streams that are opened and reset must stop there. The flood is written here frame by frame, as
RFC 9113 and RFC 7541 say."""

import base64
import json
import os
import pathlib
import shutil
import signal
import socket
import ssl
import struct
import subprocess
import tempfile
import threading
import time

import harness
from access_test import Authority, new_token
from harness import SOURCE, Server, check, run

FRAMES = 17
JSON = ("--header", "Content-Type: application/json", "--data")

FLOOD_STREAMS = 20_000
FLOOD_S = 20  # at most; what was sent by then was the flood


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return probe.getsockname()[1]


class Nginx:
    """The file that we ship, with ports, certificate and folders of the test's."""

    def __init__(self, folder, cert, key, grpc_port, http_port):
        self.folder, self.port = pathlib.Path(folder), free_port()
        text = (SOURCE / "deploy/nginx/depthtween.conf").read_text()
        for shipped, ours in (("listen 443 ssl", f"listen 127.0.0.1:{self.port} ssl"),
                              ("listen [::]:443 ssl http2;", ""),
                              ("/etc/depthtween/tls/cert.pem", str(cert)),
                              ("/etc/depthtween/tls/key.pem", str(key)),
                              ("/var/log/nginx/depthtween.log", f"{self.folder}/access.log"),
                              ("127.0.0.1:50051;", f"127.0.0.1:{grpc_port};"),
                              ("127.0.0.1:8080;", f"127.0.0.1:{http_port};")):
            if shipped not in text:
                raise AssertionError(f"deploy/nginx/depthtween.conf has no {shipped!r} for the test to replace")
            text = text.replace(shipped, ours)
        self.folder.mkdir()
        (self.folder / "depthtween.conf").write_text(text)
        temporary = "".join(f"{kind}_temp_path {self.folder}/{kind};\n"
                            for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi"))
        self.config = self.folder / "nginx.conf"
        self.config.write_text(("user root;\n" if os.geteuid() == 0 else "") +
                               f"daemon off;\nworker_processes 1;\npid {self.folder}/pid;\n"
                               "events { worker_connections 1024; }\n"
                               f"http {{\naccess_log off;\n{temporary}"
                               f"include {self.folder}/depthtween.conf;\n}}\n")
        self.log = self.folder / "error.log"
        self.process = None

    def __enter__(self):
        self.process = subprocess.Popen(["nginx", "-e", self.log, "-c", self.config], stdin=subprocess.DEVNULL)
        try:
            harness.wait_for("nginx to listen", self._listens)
        except BaseException:
            self.__exit__()
            raise
        return self

    def _listens(self):
        if self.process.poll() is not None:
            raise AssertionError(f"nginx ended with {self.process.returncode}:\n{self.log.read_text()}")
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)  # the workers end with their master
            self.process.wait(timeout=harness.PATIENCE_S)

    @property
    def address(self):
        return f"127.0.0.1:{self.port}"


def frame(kind, flags, stream, payload=b""):
    return struct.pack(">I", len(payload))[1:] + struct.pack(">BBI", kind, flags, stream) + payload


def call_head(authority):
    """The header block of a gRPC call of GetServerInfo, all fields literal and not indexed."""

    def text(value):
        return bytes([len(value)]) + value

    return (b"\x83\x87"  # :method POST, :scheme https
            + b"\x04" + text(b"/depthtween.v1.AdminService/GetServerInfo") + b"\x01" + text(authority.encode())
            + b"\x0f\x10" + text(b"application/grpc") + b"\x00" + text(b"te") + text(b"trailers"))


class Flood(threading.Thread):
    """Opens streams and resets each at once, on one connection after the other when nginx ends them."""

    def __init__(self, nginx, ca):
        super().__init__()
        self.nginx = nginx
        self.context = ssl.create_default_context(cafile=str(ca))
        self.context.set_alpn_protocols(["h2"])
        self.streams = self.connections = 0

    def run(self):
        deadline = time.monotonic() + FLOOD_S
        while self.streams < FLOOD_STREAMS and time.monotonic() < deadline:
            self.connections += 1
            try:
                self._use_up_one_connection(deadline)
            except OSError:
                pass  # nginx has ended it, which is what it should do

    def _use_up_one_connection(self, deadline):
        head = call_head(self.nginx.address)
        with socket.create_connection(("127.0.0.1", self.nginx.port), timeout=5) as plain, \
                self.context.wrap_socket(plain, server_hostname="127.0.0.1") as tls:
            tls.sendall(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + frame(4, 0, 0))
            stream = 1
            while self.streams < FLOOD_STREAMS and time.monotonic() < deadline:
                batch = b""
                for _ in range(50):
                    batch += frame(1, 4, stream, head) + frame(3, 0, stream, struct.pack(">I", 8))
                    stream += 2
                tls.settimeout(5)
                tls.sendall(batch)
                self.streams += 50
                tls.settimeout(0)
                try:
                    while tls.recv(1 << 16):
                        pass
                    return  # closed
                except (ssl.SSLWantReadError, BlockingIOError):
                    pass


def memory_bytes(pid):
    status = pathlib.Path(f"/proc/{pid}/status").read_text()
    return 1024 * int(next(line.split()[1] for line in status.splitlines() if line.startswith("VmRSS:")))


class NginxTest(harness.IntegrationTest):

    @classmethod
    def setUpClass(cls):
        cls.shared = pathlib.Path(tempfile.mkdtemp(prefix="depthtween_nginx_"))
        cls.addClassCleanup(shutil.rmtree, cls.shared, ignore_errors=True)
        cls.authority = Authority(cls.shared, "authority")
        cls.cert, cls.key = cls.authority.sign("server")
        cls.sequence = cls.shared / "kick"
        harness.synth(cls.sequence, FRAMES)

    def setUp(self):
        super().setUp()
        tokens = self.folder / "tokens.json"
        self.secret = self.folder / "secret"
        self.secret.write_text(new_token(tokens) + "\n")
        self.server = Server(self.folder / "data", options=["--tokens", tokens], http=True)
        self.server.__enter__()
        self.addCleanup(self.server.__exit__)
        self.nginx = Nginx(self.folder / "nginx", self.cert, self.key, self.server.port, self.server.http_port)
        self.nginx.__enter__()
        self.addCleanup(self.nginx.__exit__)

    def client(self, command, *arguments):
        return run("depthtween", command, *arguments, "--server", self.nginx.address, "--tls-ca", self.authority.cert,
                   "--token-file", self.secret)

    def curl_command(self, path, *arguments, secret=None):
        """With our token, unless `secret` is another or "" for none."""
        secret = self.secret.read_text().strip() if secret is None else secret
        token = ["--header", f"Authorization: Bearer {secret}"] if secret else []
        return ["curl", "--silent", "--show-error", "--max-time", str(harness.PATIENCE_S), "--cacert",
                str(self.authority.cert), *token, *map(str, arguments), f"https://{self.nginx.address}{path}"]

    def curl(self, path, *arguments, expect=200, secret=None):
        command = self.curl_command(path, "--write-out", "%{stderr}status=%{http_code}", *arguments, secret=secret)
        result = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=2 * harness.PATIENCE_S)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn(f"status={expect}".encode(), result.stderr, result.stdout)
        return result.stdout

    def healthy(self, *options):
        """Over gRPC and over HTTP."""
        grpc = run("depthtween-server", "healthcheck", "--server", self.nginx.address, "--tls-ca", self.authority.cert)
        http = subprocess.run(self.curl_command("/readyz", "--fail", *options), stdin=subprocess.DEVNULL,
                              capture_output=True, timeout=2 * harness.PATIENCE_S)
        return grpc.returncode == 0 and http.returncode == 0

    def test_a_whole_job_goes_through(self):
        out, direct = self.folder / "out", self.folder / "direct"
        name = check(self.client("submit", self.sequence, "--wait", "-o", out)).stdout.split()[0]
        harness.upsample(self.sequence, direct)
        self.assert_same_result(out, direct)
        job = json.loads(self.curl(f"/v1/{name}"))
        self.assertEqual((job["name"], job["state"]), (name, "STATE_SUCCEEDED"))
        # The same path, asked in another way, is for another listener: gRPC-Web, an empty message in one frame.
        answer = self.curl("/depthtween.v1.AdminService/GetServerInfo", "--header",
                           "Content-Type: application/grpc-web-text", "--data-binary", "AAAAAAA=")
        self.assertTrue(answer)
        self.curl("/v1/jobs/none", expect=404)
        self.assertTrue(self.healthy())

        frame = self.curl(f"/v1/{name}/outputs/depth/frames/0.png")
        self.assertEqual(frame, next(iter(sorted((out / "depth").glob("*.png")))).read_bytes())
        link = json.loads(self.curl(f"/v1/{name}:link", *JSON, "{}"))
        self.assertIn(b"STATE_SUCCEEDED", self.curl(f"/v1/{name}:watch?signature={link['signature']}", secret=""))
        self.curl(f"/v1/{name}:link?signature={link['signature']}", *JSON, "{}", expect=403, secret="")
        log = (self.nginx.folder / "access.log").read_text()
        self.assertIn(f"GET /v1/{name}:watch HTTP/2.0", log)
        self.assertNotIn(link["signature"], log)

    def test_an_upload_goes_through_as_it_comes(self):
        data = os.urandom(12_000_000)
        sequence = json.loads(self.curl("/v1/sequences", *JSON, "{}"))["name"]
        # Who did it is an address, also of what came over HTTP.
        self.assertRegex(self.server.log_text(), r"audit method=CreateSequence .* peer=127\.0\.0\.1:\d+")
        tus = ("--header", "Tus-Resumable: 1.0.0")
        path = base64.b64encode(b"rgb/000000.png").decode()
        made = self.curl(f"/v1/{sequence}/uploads:tus", "--request", "POST", "--dump-header", "-", *tus, "--header",
                         f"Upload-Length: {len(data)}", "--header", f"Upload-Metadata: path {path}", expect=201).decode()
        location = next(line.split(": ", 1)[1] for line in made.splitlines() if line.lower().startswith("location:"))

        def offset():
            head = self.curl(location, "--head", *tus).decode().lower()
            return int(next(line.split(": ")[1] for line in head.splitlines() if line.startswith("upload-offset:")))

        # Cut in the middle: a front that collects the body first would have passed on nothing.
        context = ssl.create_default_context(cafile=str(self.authority.cert))
        with socket.create_connection(("127.0.0.1", self.nginx.port)) as plain, \
                context.wrap_socket(plain, server_hostname="127.0.0.1") as cut:
            cut.sendall(f"PATCH {location} HTTP/1.1\r\nHost: x\r\nTus-Resumable: 1.0.0\r\nUpload-Offset: 0\r\n"
                        f"Authorization: Bearer {self.secret.read_text().strip()}\r\n"
                        f"Content-Type: application/offset+octet-stream\r\nContent-Length: {len(data)}\r\n\r\n".encode()
                        + data[:len(data) // 2])
        kept = harness.wait_for("what came before the cut", offset)
        self.assertLessEqual(kept, len(data) // 2)
        rest = self.folder / "rest"

        def finish():  # the upload that was cut may still hold it
            at = offset()
            rest.write_bytes(data[at:])
            self.curl(location, "--request", "PATCH", *tus, "--header", f"Upload-Offset: {at}", "--header",
                      "Content-Type: application/offset+octet-stream", "--data-binary", f"@{rest}", expect="")
            return offset() == len(data)

        harness.wait_for("the rest", finish)
        upload = json.loads(self.curl(location.removesuffix(":tus")))
        self.assertEqual(upload["state"], "STATE_FINISHED")

    def test_prometheus_reads_what_the_server_counts(self):
        self.curl("/v1/jobs")
        self.curl("/metrics", expect=403)
        operator = new_token(self.folder / "tokens.json", "default", "admin")

        def scrape():  # a new token is known within a second or two
            return subprocess.run(self.curl_command("/metrics", "--fail", secret=operator), stdin=subprocess.DEVNULL,
                                  capture_output=True, text=True, timeout=2 * harness.PATIENCE_S).stdout

        text = harness.wait_for("the numbers", scrape)
        self.assertIn('depthtween_http_requests_total{method="GET",status="200"}', text)
        self.assertIn('depthtween_calls_total{code="OK",method="ListJobs"}', text)
        self.assertIn("depthtween_ready 1\n", text)

    def test_events_come_while_the_job_runs(self):
        name = check(self.client("submit", self.sequence)).stdout.split()[0]
        tasks = harness.wait_for("a task", self.server.tasks)
        for task in tasks:
            os.kill(task.pid, signal.SIGSTOP)  # so that the job cannot end before it is looked at
        with subprocess.Popen(self.curl_command(f"/v1/{name}:watch", "--no-buffer", "--header",
                                                "Accept: text/event-stream"), stdin=subprocess.DEVNULL,
                              stdout=subprocess.PIPE, text=True) as events:
            first = next(line for line in events.stdout if line.startswith("data:"))
            self.assertIn(name, first)
            self.assertNotIn(json.loads(self.curl(f"/v1/{name}"))["state"], ("STATE_SUCCEEDED", "STATE_FAILED"))
            self.curl(f"/v1/{name}:cancel", *JSON, "{}")
            rest = events.stdout.read()
        self.assertIn("STATE_CANCELLED", rest)
        self.assertEqual(events.returncode, 0)

    def test_what_is_too_large_stops_at_nginx(self):
        large = self.folder / "large"
        large.write_bytes(b" " * (5 << 20))
        self.curl("/v1/jobs", *JSON, f"@{large}", expect=413)
        self.curl("/v1/jobs", "--header", f"X-Large: {'x' * 40_000}", "--http1.1", expect=400)

    def test_a_flood_of_reset_streams_stops_at_nginx(self):
        check(self.client("submit", self.sequence, "--wait"))  # so that the server has grown to its usual size
        before = memory_bytes(self.server.process.pid)
        flood = Flood(self.nginx, self.authority.cert)
        flood.start()
        answers = []
        try:
            while flood.is_alive():
                # Another client's address has limits of its own.
                self.curl("/readyz", "--interface", "127.0.0.2")
                answers.append(memory_bytes(self.server.process.pid))
        finally:
            flood.join()
        self.assertGreater(flood.streams, 1000)
        answered = (self.nginx.folder / "access.log").read_text().count(" /depthtween.v1.AdminService/GetServerInfo ")
        self.assertGreater(answered, 0)
        self.assertLess(answered, 1100 * flood.connections, "nginx takes 1,000 streams of a connection")
        after = max([memory_bytes(self.server.process.pid), *answers])
        print(f"{flood.streams} streams, {answered} taken, {flood.connections} connections, {before >> 20} -> {after >> 20} MiB")
        self.assertLess(after, 3 * before + 100_000_000)
        harness.wait_for("the flood's own client to be let in again", self.healthy)
        check(self.client("list"))


if __name__ == "__main__":
    harness.main()
