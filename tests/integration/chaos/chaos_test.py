"""Some rounds of kill -9 at random moments; run.py has all of it. The truth is the clients' log of what the server
acknowledged, and what `depthtween-core upsample` writes."""

import pathlib
import random
import sys

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[1]), str(pathlib.Path(__file__).resolve().parent)]

import harness  # pylint: disable=wrong-import-position
import run  # pylint: disable=wrong-import-position

ROUNDS = 8


class ChaosTest(harness.IntegrationTest):

    def test_kill_at_random_moments_loses_nothing(self):
        seed = random.SystemRandom().randrange(1 << 32)
        print(f"seed {seed}: run.py --seed {seed} --rounds {ROUNDS}", flush=True)
        chaos = run.Chaos(ROUNDS, seed, self.folder)
        self.assertEqual(chaos.run(), [])
        self.assertEqual(chaos.rounds_done, ROUNDS)
        figures = chaos.figures()
        for operation in ("bytes", "create job", "submit", "wait"):
            self.assertGreater(figures["acknowledged"].get(operation, 0), 0, figures)
        self.assertGreater(figures["results_compared"], 0, figures)


if __name__ == "__main__":
    harness.main()
