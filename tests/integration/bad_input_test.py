"""Bad recordings through the server: each is rejected with the file at fault and what to do, and the server goes on.
The truth is what was spoilt."""

import random

import harness
from harness import Recording, Server, check, png, png_header


def truncated_png(recording):
    recording.files["depth/000001.png"] = recording.files["depth/000001.png"][:-40]


def eight_bit_depth(recording):
    recording.files["depth/000001.png"] = png(recording.width, recording.height, bits=8, value=100)


def sizes_that_disagree(recording):
    recording.files["rgb/000002.png"] = png(recording.width + 2, recording.height, bits=8, colour=True, value=90)


def camera_of_another_size(recording):
    recording.camera["height"] = 2 * recording.height


def time_going_back(recording):
    recording.color_times = [0.0, 0.04, 0.02]


def zero_focal_length(recording):
    recording.camera["fx"] = 0.0


def nan_focal_length(recording):
    recording.camera["fy"] = float("nan")  # json.dumps writes NaN, which is no JSON: the file itself is at fault


def path_out_of_the_folder(recording):
    recording.files["depth.txt"] = b"0.0 depth/000000.png\n0.04 ../../../etc/passwd\n"


def missing_frame(recording):
    del recording.files["depth/000001.png"]


def missing_list(recording):
    recording.files["depth.txt"] = b""


def huge_header(recording):
    header = png_header(60000, 60000, 16, 0)
    recording.files["depth/000001.png"] = header + recording.files["depth/000001.png"][len(header):]


def empty_frame(recording):
    recording.files["rgb/000001.png"] = b""


# What is spoilt -> what the message must hold.
CASES = [
    (truncated_png, ["depth/000001.png"]),
    (eight_bit_depth, ["depth/000001.png", "8", "16"]),
    (sizes_that_disagree, ["rgb/000002.png", "66", "64"]),
    (camera_of_another_size, ["96", "48"]),
    (time_going_back, ["rgb/000002.png", "0.02", "0.04"]),
    (zero_focal_length, ["camera.json", "fx"]),
    (nan_focal_length, ["camera.json"]),
    (path_out_of_the_folder, ["depth.txt", "../../../etc/passwd"]),
    (missing_frame, ["depth/000001.png"]),
    (missing_list, ["depth.txt"]),
    (huge_header, ["depth/000001.png", "60000"]),
    (empty_frame, ["rgb/000001.png"]),
]


class BadInputTest(harness.IntegrationTest):

    def test_every_kind_is_rejected_with_the_file_at_fault(self):
        with Server(self.folder / "data") as server:
            for spoil, words in CASES:
                with self.subTest(spoil.__name__):
                    recording = Recording()
                    spoil(recording)
                    folder = self.folder / spoil.__name__
                    recording.write(folder)
                    result = server.client("submit", folder, "--wait")
                    self.assertEqual(result.returncode, harness.EXIT_INPUT_REJECTED, result.stderr)
                    for word in words:
                        self.assertIn(word, result.stderr)
                    self.assertTrue(server.is_serving())
            self.assert_good_job_succeeds(server)

    def test_every_offending_file_is_named(self):
        recording = Recording()
        truncated_png(recording)
        sizes_that_disagree(recording)
        recording.write(self.folder / "recording")
        with Server(self.folder / "data") as server:
            result = server.client("submit", self.folder / "recording")
            self.assertEqual(result.returncode, harness.EXIT_INPUT_REJECTED)
            self.assertIn("depth/000001.png", result.stderr)
            self.assertIn("rgb/000002.png", result.stderr)

    def test_implausible_depth_scale_is_a_warning_that_names_the_depth_it_implies(self):
        recording = Recording()
        recording.camera["depth_scale"] = 1.0  # 1500 stored units: 1500 m
        recording.write(self.folder / "recording")
        with Server(self.folder / "data") as server:
            result = server.client("submit", self.folder / "recording", "--wait")
            self.assertEqual(result.returncode, 0, result.stderr)
            self.assertIn("warning", result.stderr)
            self.assertIn("depth_scale", result.stderr)
            self.assertIn("1500", result.stderr)

    def test_clocks_that_do_not_meet_are_met_by_the_option_that_the_refusal_names(self):
        recording = Recording()
        recording.depth_times = [100.0, 100.04]
        recording.write(self.folder / "recording")
        with Server(self.folder / "data") as server:
            result = server.client("submit", self.folder / "recording", "--wait")
            self.assertEqual(result.returncode, harness.EXIT_JOB_FAILED, result.stderr)
            self.assertIn("--clock=100000.000", result.stderr)
            for clock in "100000", "index", "estimate":
                check(server.client("submit", self.folder / "recording", "--wait", f"--clock={clock}"))

    def test_names_of_any_language_go_there_and_back(self):
        recording = Recording()
        name = "Bild \u00fc \u6df1 (1) [x] 100% #1"
        recording.files[f"rgb dir/{name}.png"] = recording.files.pop("rgb/000001.png")
        folder = self.folder / "recording \u00fc"
        recording.write(folder)
        lines = (folder / "rgb.txt").read_text().replace("rgb/000001.png", f"rgb dir/{name}.png")
        (folder / "rgb.txt").write_bytes(b"\xef\xbb\xbf" + lines.encode())
        with Server(self.folder / "data") as server:
            check(server.client("submit", folder, "--wait", "-o", self.folder / "out"))
            self.assertTrue((self.folder / "out" / "depth" / f"{name}.png").is_file())

    def test_every_name_that_is_refused_is_told_at_once(self):
        recording = Recording()
        for number in 1, 2:
            recording.files[f"rgb/a:{number}.png"] = recording.files.pop(f"rgb/00000{number}.png")
        folder = self.folder / "recording"
        recording.write(folder)
        lines = (folder / "rgb.txt").read_text().replace("rgb/000001", "rgb/a:1").replace("rgb/000002", "rgb/a:2")
        (folder / "rgb.txt").write_text(lines)
        with Server(self.folder / "data") as server:
            result = server.client("submit", folder)
            self.assertNotEqual(result.returncode, 0)
            for word in "2 of 8 paths", "rgb/a:1.png", "rgb/a:2.png":
                self.assertIn(word, result.stderr)

    def test_random_damage_to_a_frame_ends_no_server(self):
        seed = 20240601
        print(f"seed {seed}")
        generator = random.Random(seed)
        with Server(self.folder / "data") as server:
            for round_number in range(4):
                recording = Recording()
                for name, data in recording.files.items():
                    damaged = bytearray(data)
                    for _ in range(4):
                        damaged[generator.randrange(len(damaged))] = generator.randrange(256)
                    recording.files[name] = bytes(damaged[:generator.randrange(1, len(damaged) + 1)])
                recording.write(self.folder / str(round_number))
                result = server.client("submit", self.folder / str(round_number), "--wait")
                self.assertEqual(result.returncode, harness.EXIT_INPUT_REJECTED, result.stderr)
                self.assertTrue(server.is_serving())
            self.assert_good_job_succeeds(server)

    def assert_good_job_succeeds(self, server):
        Recording().write(self.folder / "good")
        check(server.client("submit", self.folder / "good", "-o", self.folder / "good_out"))
        self.assertEqual(len(list((self.folder / "good_out" / "depth").glob("*.png"))), 3)


if __name__ == "__main__":
    harness.main()
