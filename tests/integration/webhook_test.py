"""Webhooks, with the real programs and receivers of this driver, which check the signature by Python's own hmac, as
https://www.standardwebhooks.com says it is made."""

import base64
import hashlib
import hmac
import http.server
import json
import os
import ssl
import threading
import time
import unittest.mock

import harness
from access_test import Authority
from harness import Recording, Server, check, wait_for

SECRET = b"depthtween webhook secret 123456"


class Receiver:
    """Answers the first request with the first status, and so on; the last one stands for all that follow."""

    def __init__(self, statuses, cert=None, key=None):
        self.requests = []
        left = list(statuses)

        class Handler(http.server.BaseHTTPRequestHandler):

            def do_POST(handler):  # pylint: disable=no-self-argument,invalid-name
                body = handler.rfile.read(int(handler.headers["Content-Length"]))
                self.requests.append((handler.headers, body))
                handler.send_response(left.pop(0) if len(left) > 1 else left[0])
                handler.end_headers()

            def log_message(handler, *_):  # pylint: disable=no-self-argument,arguments-differ
                pass

        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.scheme = "http"
        if cert is not None:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.load_cert_chain(cert, key)
            self._server.socket = context.wrap_socket(self._server.socket, server_side=True)
            self.scheme = "https"
        self._thread = threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.05})

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()

    @property
    def port(self):
        return self._server.server_address[1]

    @property
    def url(self):
        return f"{self.scheme}://127.0.0.1:{self.port}/depthtween"


class WebhookTest(harness.IntegrationTest):

    def setUp(self):
        super().setUp()
        self.key = self.folder / "key"
        self.key.write_text(f"whsec_{base64.b64encode(SECRET).decode()}\n")
        self.sequence = self.folder / "recording"
        Recording().write(self.sequence)

    def server(self, *options):
        return Server(self.folder / "data", options=("--webhook-key", self.key, *options), http=True)

    def submit(self, server, url):
        """The name of a job that is to tell its end."""
        return check(server.client("submit", self.sequence, "--method", "hold", "--webhook", url)).stdout.strip()

    def webhook(self, server, job, state):
        def reached():
            webhook = server.http("GET", f"/v1/{job}")[1]["webhook"]
            return webhook if webhook["state"] == state else None
        return wait_for(f"the webhook of {job} to be {state}", reached)

    def failed(self, server, job):
        """Why the first attempt failed."""
        return wait_for("an attempt", lambda: server.http("GET", f"/v1/{job}")[1]["webhook"]["lastError"])

    def assert_signed(self, headers, body):
        signed = f"{headers['webhook-id']}.{headers['webhook-timestamp']}.".encode() + body
        digest = hmac.new(SECRET, signed, hashlib.sha256).digest()
        self.assertEqual(headers["webhook-signature"], "v1," + base64.b64encode(digest).decode())
        self.assertLess(abs(time.time() - int(headers["webhook-timestamp"])), harness.PATIENCE_S)

    def test_is_sent_until_it_is_taken_across_a_kill(self):
        with Receiver([500, 503, 200]) as receiver, self.server("--webhook-allow-private") as server:
            job = self.submit(server, receiver.url)
            wait_for("the first attempt", lambda: receiver.requests)
            server.kill()
            server.start()
            webhook = self.webhook(server, job, "STATE_DELIVERED")
            self.assertEqual(webhook["lastError"], "")
            self.assertNotIn("nextAttemptTime", webhook)
            # The kill may have come before the first attempt was recorded.
            self.assertIn(webhook["attempts"], (2, 3))
            self.assertEqual(len(receiver.requests), 3)
            self.assertEqual(len({headers["webhook-id"] for headers, _ in receiver.requests}), 1)
            for headers, body in receiver.requests:
                self.assert_signed(headers, body)
            now = server.http("GET", f"/v1/{job}")[1]
            del now["webhook"]
            self.assertEqual(json.loads(receiver.requests[-1][1]), now)
            self.assertEqual(now["state"], "STATE_SUCCEEDED")

    def test_goes_to_public_addresses_alone(self):
        with Receiver([200]) as receiver, self.server() as server:
            for url in (receiver.url, f"https://127.0.0.1:{receiver.port}/", "https://[::1]/",
                        "https://169.254.169.254/latest"):
                refused = server.client("submit", self.sequence, "--method", "hold", "--webhook", url)
                self.assertNotEqual(refused.returncode, 0, url)
                self.assertIn("job.webhook.url", refused.stderr)
            # A name is looked up when it is used.
            job = self.submit(server, f"https://localhost:{receiver.port}/")
            self.assertIn("is no address of the public internet", self.failed(server, job))
            self.assertEqual(receiver.requests, [])

    def test_a_server_without_a_key_says_so(self):
        with Server(self.folder / "data") as server:
            refused = server.client("submit", self.sequence, "--method", "hold", "--webhook", "https://example.org/")
            self.assertNotEqual(refused.returncode, 0)
            self.assertIn("--webhook-key", refused.stderr)

    def test_trusts_the_authorities_of_the_system(self):
        authority = Authority(self.folder, "authority")
        with Receiver([200], *authority.sign("receiver")) as receiver:
            with self.server("--webhook-allow-private") as server:
                job = self.submit(server, receiver.url)
                self.assertIn("certificate is not trusted", self.failed(server, job))
                self.assertEqual(receiver.requests, [])
                server.stop()
                # As OpenSSL takes it in place of the system's own.
                with unittest.mock.patch.dict(os.environ, {"SSL_CERT_FILE": str(authority.cert)}):
                    server.start()
                self.webhook(server, job, "STATE_DELIVERED")
                self.assert_signed(*receiver.requests[0])


if __name__ == "__main__":
    harness.main()
