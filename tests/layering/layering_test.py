"""The tree keeps its order, and the check that says so sees every kind of wrong edge."""

import pathlib
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import layering  # noqa: E402: found beside this file

ROOT = pathlib.Path(__file__).resolve().parents[2]


class Repository(unittest.TestCase):
    def test_no_wrong_edge(self):
        found = layering.violations(ROOT)
        self.assertFalse(found, "wrong edges; for the order see the code map in ARCHITECTURE.md:\n" + "\n".join(found))

    # The check would also be content with an empty tree.
    def test_sees_the_sources(self):
        includes = layering.Tree(ROOT).includes
        for module in layering.MODULES:
            self.assertTrue(any(layering.module_of(path, layering.MODULES) == module for path in includes), module)
        libraries = {module for _, module, _ in layering.Tree(ROOT).libraries()}
        self.assertEqual(set(layering.MODULES) - {"server", "proto/depthtween"}, libraries)


class PlantedEdges(unittest.TestCase):
    """Small trees that are right but for one edge, which must be named, alone."""

    RIGHT = {
        "core/base/status.h": '#include "absl/status/status.h"\n',
        "core/flow/CMakeLists.txt": "depthtween_library(core/flow DEPS core_base opencv_video)\n",
        "core/flow/flow.h": '#include "core/base/status.h"\n',
        "core/flow/flow.cc": '#include "core/flow/flow.h"\n\n#include <opencv2/video.hpp>\n#include <vector>\n',
        "server/store/store.h": "",
        "server/jobs/jobs.h": '// #include "server/rpc/service.h" would be wrong\n',
        "server/rpc/service.h": '#include "depthtween/v1/job.grpc.pb.h"\n',
        "client/lib/jobs.h": "#include <grpcpp/grpcpp.h>\n",
        "tests/server/jobs/jobs_test.cc": '#include "server/jobs/jobs.h"\n#include "gtest/gtest.h"\n',
    }

    def violations(self, files):
        with tempfile.TemporaryDirectory() as root:
            for path, text in {**self.RIGHT, **files}.items():
                file = pathlib.Path(root, path)
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(text, encoding="utf-8")
            return layering.violations(root)

    def assert_caught(self, path, text, *words):
        found = self.violations({path: text})
        self.assertEqual(1, len(found), found)
        for word in (path, *words):
            self.assertIn(word, found[0])

    def test_the_right_tree_is_right(self):
        self.assertEqual([], self.violations({}))

    def test_upwards_include(self):
        self.assert_caught("core/base/image.h", '#include "core/flow/flow.h"\n', "core/base must not know core/flow")

    def test_core_that_knows_grpc(self):
        self.assert_caught("core/flow/remote.cc", "#include <grpcpp/grpcpp.h>\n", "core/flow must not know gRPC")

    def test_core_that_knows_a_message(self):
        self.assert_caught("core/base/job.cc", '#include "depthtween/v1/job.pb.h"\n', "must not know protobuf")

    def test_client_that_includes_core(self):
        self.assert_caught("client/lib/x.cc", '#include "core/flow/flow.h"\n', "client/lib must not know core/flow")

    def test_client_that_includes_server(self):
        self.assert_caught("client/lib/x.cc", '#include "server/store/store.h"\n', "must not know server/store")

    def test_jobs_that_know_rpc(self):
        self.assert_caught("server/jobs/x.cc", '#include "server/rpc/service.h"\n', "must not know server/rpc")
        self.assert_caught("server/jobs/x.cc", "#include <google/protobuf/message.h>\n", "must not know protobuf")

    def test_tests_may_use_the_library_but_nothing_above_it(self):
        self.assertEqual([], self.violations({"tests/core/base/x_test.cc": '#include "core/flow/flow.h"\n'}))
        self.assert_caught("tests/core/base/x_test.cc", '#include "server/store/store.h"\n', "must not know server/store")
        self.assert_caught("tests/client/lib/x_test.cc", '#include "core/flow/flow.h"\n', "must not know core/flow")

    def test_tests_of_jobs_that_need_rpc(self):
        self.assert_caught("tests/server/jobs/x_test.cc", "#include <grpcpp/grpcpp.h>\n", "built without RPC")

    def test_server_that_calls_an_algorithm(self):
        self.assert_caught("server/rpc/x.cc", '#include "core/flow/flow.h"\n', "server/rpc must not know core/flow")

    def test_sources_that_include_tests(self):
        self.assert_caught("core/base/x.cc", '#include "tests/server/jobs/jobs_test.cc"\n', "only tests")

    def test_path_that_is_not_from_the_root(self):
        self.assert_caught("core/flow/x.cc", '#include "flow.h"\n', "paths from the root")
        self.assert_caught("core/flow/x.cc", '#include "../base/status.h"\n', "paths from the root")
        self.assert_caught("core/flow/x.cc", "#include <core/base/status.h>\n", "with quotes")

    def test_link_upwards(self):
        self.assert_caught("core/base/CMakeLists.txt", "depthtween_library(core/base DEPS core_flow)\n",
                           "core/base must not know core/flow")

    def test_link_to_a_foreign_library(self):
        self.assert_caught("server/jobs/CMakeLists.txt", "depthtween_library(server/jobs DEPS gRPC::grpc++)\n",
                           "server/jobs must not know gRPC")

    def test_include_without_link(self):
        self.assert_caught("core/fill/fill.cc", '#include "core/base/status.h"\n', "DEPS of core/fill do not reach")

    def test_folder_without_a_place_in_the_order(self):
        self.assert_caught("core/magic/x.h", "", "belongs to no module")

    def test_cycle(self):
        found = self.violations({"core/base/a.h": '#include "core/base/b.h"\n',
                                 "core/base/b.h": '#include "core/base/a.h"\n'})
        self.assertEqual(["core/base/a.h -> core/base/b.h -> core/base/a.h: a cycle of includes"], found)


class Order(unittest.TestCase):
    def test_modules_form_no_cycle(self):
        for module, lower in layering.MODULES.items():
            for name in lower:
                self.assertNotIn(module, layering.below(name, layering.MODULES))


if __name__ == "__main__":
    unittest.main()
