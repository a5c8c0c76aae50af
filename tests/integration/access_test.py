"""Who gets in: TLS, certificates of clients, tokens and tenants, with the real programs and certificates made here by
openssl. What is right follows from how each certificate and token was made."""

import contextlib
import http.client
import json
import pathlib
import re
import shutil
import subprocess
import tempfile
import threading
import unittest

import harness
from harness import Recording, Server, check, run


def openssl(*arguments):
    subprocess.run(["openssl", *map(str, arguments)], check=True, capture_output=True, timeout=harness.PATIENCE_S)


class Authority:
    """Signs certificates, as an operator's own authority does."""

    def __init__(self, folder, name):
        self.folder = pathlib.Path(folder)
        self.cert, self.key = self.folder / f"{name}.pem", self.folder / f"{name}.key"
        openssl("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "2", "-subj",
                f"/CN={name}", "-keyout", self.key, "-out", self.cert)

    def sign(self, name, address="IP:127.0.0.1"):
        key, request, cert = (self.folder / f"{name}.{end}" for end in ("key", "csr", "pem"))
        openssl("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-subj", f"/CN={name}",
                "-keyout", key, "-out", request)
        extensions = self.folder / f"{name}.ext"
        extensions.write_text(f"subjectAltName={address}\n")
        openssl("x509", "-req", "-in", request, "-CA", self.cert, "-CAkey", self.key, "-CAcreateserial", "-days", "2",
                "-extfile", extensions, "-out", cert)
        return cert, key


def new_token(file, tenant="default", scopes="read,write", *more):
    made = check(run("depthtween-server", "token", "new", "--tokens", file, "--tenant", tenant, "--scopes", scopes,
                     *more))
    return made.stdout.splitlines()[-1]


class AccessTest(harness.IntegrationTest):

    @classmethod
    def setUpClass(cls):
        cls.shared = pathlib.Path(tempfile.mkdtemp(prefix="depthtween_access_"))
        cls.addClassCleanup(shutil.rmtree, cls.shared, ignore_errors=True)
        cls.authority = Authority(cls.shared, "authority")
        cls.cert, cls.key = cls.authority.sign("server")
        cls.sequence = cls.shared / "recording"
        Recording().write(cls.sequence)

    def token_file(self, name, secret):
        file = self.folder / name
        file.write_text(secret + "\n")
        return file

    def tls(self, *more):
        return ["--tls-cert", self.cert, "--tls-key", self.key, *more]

    def test_a_whole_job_over_tls_with_a_token(self):
        tokens = self.folder / "tokens.json"
        secret = new_token(tokens, "studio")
        with Server(self.folder / "data", options=self.tls("--tokens", tokens)) as server:
            reach = ["--tls-ca", self.authority.cert, "--token-file", self.token_file("secret", secret)]
            check(server.client("submit", self.sequence, "--wait", "-o", self.folder / "out", *reach))
            self.assertEqual(len(list((self.folder / "out" / "depth").glob("*.png"))), 3)
            self.assertEqual(run("depthtween-server", "healthcheck", "--server", server.address, "--tls-ca",
                                 self.authority.cert).returncode, 0)
            log = server.log_text()
            self.assertNotIn(secret, log)
            self.assertIn("audit", log)
            self.assertIn("tenant=studio", log)

    def test_each_kind_of_stranger_is_told_what_is_missing(self):
        tokens = self.folder / "tokens.json"
        new_token(tokens)
        reader = self.token_file("reader", new_token(tokens, "default", "read"))
        guess = self.token_file("guess", "dt_guess")
        ca = ["--tls-ca", self.authority.cert]
        stranger = Authority(self.folder, "stranger")
        with Server(self.folder / "data", options=self.tls("--tokens", tokens)) as server:
            for options, words in ((ca, "--token-file"),
                                   ([*ca, "--token-file", guess], "not known"),
                                   ([], "--tls-ca"),
                                   (["--tls-ca", stranger.cert], "--tls-ca"),
                                   ([*ca, "--token-file", self.folder / "none"], "--token-file")):
                result = server.client("list", *options, patience_s=0)
                self.assertNotEqual(result.returncode, 0, options)
                self.assertIn(words, result.stderr, options)
            check(server.client("list", *ca, "--token-file", reader))
            refused = server.client("submit", self.sequence, *ca, "--token-file", reader)
            self.assertNotEqual(refused.returncode, 0)
            self.assertIn("scope write", refused.stderr)

    def test_tenants_do_not_see_one_another(self):
        tokens = self.folder / "tokens.json"
        mine = self.token_file("mine", new_token(tokens, "mine"))
        other = self.token_file("other", new_token(tokens, "other"))
        with Server(self.folder / "data", options=["--tokens", tokens]) as server:
            name = check(server.client("submit", self.sequence, "--token-file", mine)).stdout.strip()
            self.assertIn(name, check(server.client("list", "--token-file", mine)).stdout)
            self.assertNotIn(name, check(server.client("list", "--token-file", other)).stdout)
            for command in ("watch", "cancel", "delete"):
                result = server.client(command, name, "--token-file", other)
                self.assertNotEqual(result.returncode, 0, command)
                self.assertIn(f"there is no {name}", result.stderr)

    # What each operation needs stands in /openapi.json, so a new one is tried without a change here.
    def test_every_route_of_the_description_is_guarded(self):
        tokens = self.folder / "tokens.json"
        everything = {"read", "write", "admin"}
        mine = new_token(tokens, "mine", ",".join(everything))
        other = new_token(tokens, "other", ",".join(everything))
        expired = new_token(tokens, "expired", ",".join(everything))
        listed = json.loads(tokens.read_text())
        next(token for token in listed["tokens"] if token["tenant"] == "expired")["expire_time"] = "2020-01-01T00:00:00Z"
        tokens.write_text(json.dumps(listed))
        without = {scope: new_token(tokens, "mine", ",".join(everything - {scope})) for scope in everything}

        with Server(self.folder / "data", options=["--tokens", tokens], http=True) as server:
            check(server.client("submit", self.sequence, "--wait", "--token-file", self.token_file("mine", mine)))
            token = {"Authorization": f"Bearer {mine}"}
            job = server.http("GET", "/v1/jobs", headers=token)[1]["jobs"][0]["name"]
            sequence = server.http("POST", "/v1/sequences", {}, headers=token)[1]["name"]
            upload = server.http("POST", f"/v1/{sequence}/uploads", {"files": [{"path": "a", "sizeBytes": 4}]},
                                 headers=token)[1]["name"]
            document = server.http("GET", "/openapi.json")[1]
            real = {"job": job, "sequence": sequence, "upload": upload, "output": "/depth", "frame": "/0",
                    "format": "/png"}
            headers = {"Tus-Resumable": "1.0.0", "Upload-Length": "4", "Upload-Metadata": "path Yg==",
                       "Upload-Offset": "0", "X-HTTP-Method-Override": "PATCH"}

            # Requests whose fields are looked at before the resource.
            bodies = {"Upload": {"files": [{"path": "b", "sizeBytes": 1}]}}

            def call(method, path, secret, content):
                content_type, schema = next(iter(content.items()), (None, {}))
                reference = schema.get("schema", {}).get("$ref", "").split("/")[-1]
                sent = {**(headers if ":tus" in path else {}), **({"Content-Type": content_type} if content_type else {})}
                if secret is not None:
                    sent["Authorization"] = f"Bearer {secret}"
                body = json.dumps(bodies.get(reference, {})) if content_type == "application/json" else ""
                connection = http.client.HTTPConnection("127.0.0.1", server.http_port, timeout=harness.PATIENCE_S)
                with contextlib.closing(connection):
                    connection.request(method, path, body, sent)
                    answer = connection.getresponse()
                    # Of a stream that is let through, the head is enough.
                    return answer.status

            operations = [(path, verb.upper(), operation) for path, verbs in document["paths"].items()
                          for verb, operation in verbs.items() if "405" not in operation["responses"]]
            # Those for operators last: one of them may be the server's end.
            operations.sort(key=lambda one: one[2]["security"] == [{"bearer": ["admin"]}])
            self.assertGreater(len(operations), 40)
            tried = set()
            for path, method, operation in operations:
                with self.subTest(f"{method} {path}"):
                    names = re.findall(r"{(\w+)}", path)
                    self.assertEqual(set(names) - real.keys(), set(), "a new kind of resource: tell the test of one")
                    theirs = re.sub(r"{(\w+)}", lambda name: real[name[1]].split("/")[-1], path)
                    made_up = re.sub(r"{(\w+)}", lambda name: "0" if name[1] == "frame" else "png" if name[1] == "format"
                                     else "none", path)
                    content = operation.get("requestBody", {}).get("content", {})
                    if operation["security"] == []:
                        self.assertNotIn(call(method, made_up, None, content), (401, 403))
                        continue
                    scopes = operation["security"][0]["bearer"]
                    self.assertTrue(scopes and everything.issuperset(scopes), scopes)
                    tried.update(scopes)
                    self.assertEqual(call(method, theirs, None, content), 401)
                    self.assertEqual(call(method, theirs, "dt_guess", content), 401)
                    self.assertEqual(call(method, theirs, expired, content), 401)
                    for scope in scopes:
                        self.assertEqual(call(method, theirs, without[scope], content), 403, scope)
                    if names:
                        self.assertEqual(call(method, theirs, other, content), 404)
                    self.assertNotIn(call(method, made_up, mine, content), (401, 403, 405))
            self.assertEqual(tried, everything)

    def test_a_signed_link_opens_one_output_without_a_token(self):
        tokens = self.folder / "tokens.json"
        secret = new_token(tokens, "studio")
        with Server(self.folder / "data", options=["--tokens", tokens], http=True) as server:
            check(server.client("submit", self.sequence, "--wait", "-o", self.folder / "out", "--token-file",
                                self.token_file("secret", secret)))
            token = {"Authorization": f"Bearer {secret}"}
            name = server.http("GET", "/v1/jobs", headers=token)[1]["jobs"][0]["name"]
            status, link = server.http("POST", f"/v1/{name}/outputs/depth:link", body={}, headers=token)
            self.assertEqual(status, 200, link)

            def get(path, signature):
                url = f"http://127.0.0.1:{server.http_port}/v1/{path}?signature={signature}"
                result = subprocess.run(["curl", "--silent", "--write-out", "%{http_code}", "--output",
                                         self.folder / "got", url], capture_output=True, text=True,
                                        timeout=harness.PATIENCE_S)
                return int(result.stdout), (self.folder / "got").read_bytes()

            depth = sorted((self.folder / "out" / "depth").glob("*.png"))
            self.assertEqual(get(f"{name}/outputs/depth/frames/1.png", link["signature"]), (200, depth[1].read_bytes()))
            self.assertEqual(get(f"{name}/outputs/depth.zip", link["signature"])[0], 200)
            self.assertEqual(get(f"{name}/outputs/uncertainty/frames/1.png", link["signature"])[0], 401)
            self.assertEqual(get(f"{name}/outputs/depth/frames/1.png", link["signature"][:-2])[0], 401)
            self.assertEqual(get("jobs", link["signature"])[0], 403)

    def test_a_revoked_token_is_refused_soon(self):
        tokens = self.folder / "tokens.json"
        keep = self.token_file("keep", new_token(tokens))
        lost = self.token_file("lost", new_token(tokens))
        listed = check(run("depthtween-server", "token", "list", "--tokens", tokens)).stdout
        ids = [line.split()[0] for line in listed.splitlines()[1:]]
        self.assertEqual(len(ids), 2)
        with Server(self.folder / "data", options=["--tokens", tokens]) as server:
            check(server.client("list", "--token-file", lost))
            check(run("depthtween-server", "token", "revoke", "--tokens", tokens, ids[1]))
            harness.wait_for("the token to be refused",
                             lambda: server.client("list", "--token-file", lost).returncode != 0)
            check(server.client("list", "--token-file", keep))

    def test_a_client_without_a_certificate_is_refused(self):
        clients = Authority(self.folder, "clients")
        cert, key = clients.sign("client")
        with Server(self.folder / "data", options=self.tls("--tls-client-ca", clients.cert)) as server:
            probe = ["depthtween-server", "healthcheck", "--server", server.address, "--tls-ca", self.authority.cert]
            self.assertEqual(run(*probe, "--tls-cert", cert, "--tls-key", key).returncode, 0)
            self.assertNotEqual(run(*probe, "--timeout", "2").returncode, 0)
            named = run(*probe, "--tls-cert", cert, "--tls-key", key, "--tls-name", "other.example.org", "--timeout", "2")
            self.assertNotEqual(named.returncode, 0)
            ca = ["--tls-ca", self.authority.cert]
            check(server.client("list", *ca, "--tls-cert", cert, "--tls-key", key))
            self.assertNotEqual(server.client("list", *ca, patience_s=0).returncode, 0)
            self.assertNotEqual(server.client("list", *ca, "--tls-cert", self.cert, "--tls-key", self.key,
                                              patience_s=0).returncode, 0, "signed by another")

    def test_certificates_change_under_load_without_a_failed_call(self):
        live = {"cert": self.folder / "live.pem", "key": self.folder / "live.key"}

        def install(cert, key):
            for name, source in (("key", key), ("cert", cert)):
                copy = live[name].with_suffix(".new")
                shutil.copy(source, copy)
                copy.rename(live[name])

        def serial(address):
            shown = subprocess.run(["openssl", "s_client", "-connect", address, "-alpn", "h2"], capture_output=True,
                                   stdin=subprocess.DEVNULL, timeout=harness.PATIENCE_S)
            parsed = subprocess.run(["openssl", "x509", "-noout", "-serial"], input=shown.stdout, capture_output=True,
                                    timeout=harness.PATIENCE_S)
            return parsed.stdout

        install(self.cert, self.key)
        options = ["--tls-cert", live["cert"], "--tls-key", live["key"]]
        with Server(self.folder / "data", options=options) as server:
            before = serial(server.address)
            failures, calls, enough = [], [0], threading.Event()

            def call():
                while not enough.is_set():
                    result = server.client("list", "--tls-ca", self.authority.cert, patience_s=0)
                    calls[0] += 1
                    if result.returncode != 0:
                        failures.append(result.stderr)

            caller = threading.Thread(target=call)
            caller.start()
            try:
                install(*self.authority.sign("renewed"))
                harness.wait_for("the new certificate", lambda: serial(server.address) not in (b"", before))
                seen = calls[0]
                harness.wait_for("calls after it", lambda: calls[0] > seen + 2)
            finally:
                enough.set()
                caller.join()
            self.assertEqual(failures, [])
            self.assertGreater(calls[0], 0)

    def test_a_page_cannot_lead_a_browser_to_a_server_without_tokens(self):
        def status(server, host):
            connection = http.client.HTTPConnection("127.0.0.1", server.http_port, timeout=harness.PATIENCE_S)
            with contextlib.closing(connection):
                connection.request("GET", "/v1/jobs", headers={"Host": host})
                return connection.getresponse().status

        tokens = self.folder / "tokens.json"
        new_token(tokens)
        with Server(self.folder / "data", http=True, options=["--allow-host", "depth.example"]) as server:
            for host in ("localhost", f"127.0.0.1:{server.http_port}", "[::1]:80", "depth.example"):
                self.assertEqual(status(server, host), 200, host)
            self.assertEqual(status(server, "rebound.example"), 403)
        with Server(self.folder / "data", http=True, options=["--tokens", tokens]) as server:
            self.assertEqual(status(server, "depth.example"), 401, "the token decides")

    def test_open_addresses_need_tls_and_tokens(self):
        refused = run("depthtween-server", "serve", "--data-dir", self.folder / "data", "--listen", "0.0.0.0:0")
        self.assertEqual(refused.returncode, harness.EXIT_USAGE)
        self.assertIn("--tls-cert, --tls-key and --tokens", refused.stderr)
        half = run("depthtween-server", "serve", "--data-dir", self.folder / "data", "--listen", "0.0.0.0:0",
                   *self.tls())
        self.assertEqual(half.returncode, harness.EXIT_USAGE)
        self.assertIn("without --tokens", half.stderr)

    def test_files_that_do_not_fit_are_named(self):
        other_cert, other_key = self.authority.sign("other")
        for options, words in ((["--tls-cert", self.cert], "--tls-key is missing"),
                               (["--tls-cert", self.cert, "--tls-key", other_key], "does not belong"),
                               (["--tls-cert", self.sequence / "rgb.txt", "--tls-key", other_key], "no certificate"),
                               (["--tls-cert", self.folder / "none", "--tls-key", other_key], "cannot be read"),
                               (self.tls("--tls-client-ca", other_key), "no certificate"),
                               (["--tokens", self.folder / "none"], "--tokens")):
            result = run("depthtween-server", "serve", "--data-dir", self.folder / "data", "--listen", "127.0.0.1:0",
                         *options)
            self.assertIn(result.returncode, (harness.EXIT_FAILED, harness.EXIT_USAGE), options)
            self.assertIn(words, result.stderr, options)


if __name__ == "__main__":
    harness.main()
