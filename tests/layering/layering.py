"""Who may know whom: the one-way order of ARCHITECTURE.md, checked on the #include lines and on what CMake links.

A module is a folder of sources; its library has the same name with "_" for "/". MODULES names, for each, the modules
right below it; it may use those and everything below them. EXTERNAL names the libraries that only some modules may
know.
"""

import pathlib
import re

MODULES = {
    "core/base": [],
    "core/geometry": ["core/base"],
    # What a task gives up before it reads a stranger's file.
    "core/sandbox": ["core/base"],
    # How a task comes to life: servers and depthtween-core do it together.
    "core/launch": [],
    "core/sequence": ["core/geometry"],
    # The one list of options. It knows no pixels: servers and clients may know it.
    "core/options": ["core/sequence"],
    "core/flags": ["core/options"],
    "core/io": ["core/sequence"],
    "core/flow": ["core/sequence"],
    "core/raster": ["core/sequence"],
    "core/fill": ["core/sequence"],
    "core/solve": ["core/flow", "core/fill", "core/options"],
    "core/capture": ["core/flow", "core/fill"],
    "core/upsample": ["core/solve", "core/raster"],
    "core/sceneflow": ["core/upsample"],
    "core/baselines": ["core/upsample"],
    # The library's public header and what stands behind it.
    "core/api": ["core/options", "core/baselines"],
    "core/metrics": ["core/sequence"],
    "core/synthetic": ["core/io"],
    "core/render": ["core/fill"],
    "core/session": ["core/api", "core/capture", "core/sceneflow", "core/metrics", "core/render", "core/io"],
    "core/tools": ["core/session", "core/synthetic", "core/flags", "core/sandbox", "core/launch"],
    # Headers that both sides of the wire share; they know no generated type of ours.
    "proto/depthtween": [],
    # The server knows recordings as values and files, never the algorithms: those run in child processes.
    "server/telemetry": [],
    "server/store": ["core/options", "proto/depthtween", "server/telemetry"],
    "server/access": ["server/store", "server/telemetry"],
    "server/jobs": ["server/store", "server/telemetry", "core/launch"],
    "server/rpc": ["server/access", "server/jobs", "core/io"],
    # A client of the server's own gRPC, so that one guard sees every call. It knows neither services nor store.
    "server/http": ["server/access", "server/telemetry"],
    # Calls others, over HTTP; it knows neither jobs nor messages.
    "server/webhooks": ["server/store", "server/telemetry"],
    "server": ["server/rpc", "server/http", "server/webhooks", "core/sandbox"],
    "client/lib": ["proto/depthtween", "core/base"],
    "client/cli": ["client/lib", "core/flags"],
}

# (what it is, the headers as a regular expression, the CMake targets as one, the modules that may know it)
EXTERNAL = [
    ("gRPC", r"grpc(pp)?/", r"gRPC::|grpc\+\+", ["server/rpc", "server/http", "client/lib", "client/cli"]),
    ("protobuf", r"google/|depthtween/v1/", r"protobuf::|depthtween_proto", ["server/rpc", "server/http", "client/lib", "client/cli", "proto/depthtween"]),
    ("SQLite", r"sqlite", r"SQLite", ["server/store"]),
    ("HTTP", r"boost/|curl/|httplib", r"Boost::|CURL::", ["server/http", "server/webhooks"]),
    ("OpenCV", r"opencv2/", r"opencv_", ["core/flow", "core/baselines", "core/api", "core/session"]),
    ("the codecs of libav", r"libav|libsw", r"PkgConfig::LIBAV", ["core/io"]),
    ("CLI11", r"CLI/", r"CLI11::", ["core/flags", "core/tools", "server", "client/cli"]),
    ("prometheus-cpp", r"prometheus/", r"prometheus_core", ["server/telemetry", "server/rpc"]),
    ("spdlog", r"spdlog/", r"spdlog::", ["server/telemetry", "server/rpc"]),
    ("GoogleTest", r"g(test|mock)/", r"GTest::", []),
]

# Where sources lie; generated ones and those of others are not there.
SOURCE_FOLDERS = ["core", "server", "client", "proto/depthtween", "tests"]
INCLUDE = re.compile(r'^\s*#\s*include\s*(["<])([^">]+)[">]', re.MULTILINE)
LIBRARY = re.compile(r"^\s*depthtween_library\(\s*(\S+)([^)]*)\)", re.MULTILINE)
OUR_FOLDERS = ("core", "server", "client", "proto", "tests")


def below(module, modules):
    """The modules that `module` may use: itself and everything under it."""
    found, todo = set(), [module]
    while todo:
        current = todo.pop()
        if current not in found:
            found.add(current)
            todo += modules[current]
    return found


def module_of(path, modules):
    """The innermost module that holds the file, or None."""
    for parent in pathlib.PurePosixPath(path).parents:
        if str(parent) in modules:
            return str(parent)
    return None


def is_test(path):
    return path.startswith("tests/")


def without_comments(text):
    return re.sub(r"//[^\n]*", "", re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL))


class Tree:
    """The sources under a root, as file -> [(quote, included path)]."""

    def __init__(self, root):
        self.root = pathlib.Path(root)
        self.includes = {}
        for folder in SOURCE_FOLDERS:
            for file in sorted((self.root / folder).rglob("*")):
                if file.suffix in (".h", ".cc") and "node_modules" not in file.parts:
                    text = without_comments(file.read_text(encoding="utf-8"))
                    self.includes[file.relative_to(self.root).as_posix()] = INCLUDE.findall(text)

    def libraries(self):
        """Of each depthtween_library(): (the CMakeLists.txt, module, what it links)."""
        for folder in ("core", "server", "client"):
            for file in sorted((self.root / folder).rglob("CMakeLists.txt")):
                text = re.sub(r"#[^\n]*", "", file.read_text(encoding="utf-8"))
                for module, arguments in LIBRARY.findall(text):
                    words = arguments.split()
                    links = words[words.index("DEPS") + 1:] if "DEPS" in words else []
                    yield file.relative_to(self.root).as_posix(), module, links


def check_include(path, quote, included, tree, modules):
    """What is wrong with one #include line, or None."""
    # A test stands where the module stands that it tests.
    home = module_of(path.removeprefix("tests/"), modules)
    target_is_ours = included in tree.includes
    looks_ours = included.split("/")[0] in OUR_FOLDERS or (quote == '"' and "/" not in included)
    if "./" in included or (looks_ours and not target_is_ours):
        return "includes are paths from the root of the repository, and this one leads nowhere"
    if quote == "<" and target_is_ours:
        return "a file of the repository is included with quotes"
    if target_is_ours and is_test(included):
        return None if is_test(path) else "only tests may include tests"
    if target_is_ours and home is not None:
        target = module_of(included, modules)
        if target is None:
            return f"{included} belongs to no module of tests/layering/layering.py"
        # Tests of the library may look at a module with all of it: the synthetic world is there for that.
        of_library = is_test(path) and home.startswith("core/") and target.startswith("core/")
        if target not in below(home, modules) and not of_library:
            return f"{home} must not know {target}"
    for what, headers, _, allowed in EXTERNAL:
        if not is_test(path) and re.match(headers, included) and home not in allowed:
            return f"{home} must not know {what}"
    # Tests may use what they like to look at a module, but server/jobs and server/store are also built without RPC.
    if is_test(path) and home in ("server/jobs", "server/store") and re.match(r"grpc|google/|depthtween/v1/", included):
        return f"tests of {home} are built without RPC"
    return None


def include_violations(tree, modules):
    for path, lines in tree.includes.items():
        if not is_test(path) and module_of(path, modules) is None:
            yield f"{path}: belongs to no module of tests/layering/layering.py"
            continue
        for quote, included in lines:
            problem = check_include(path, quote, included, tree, modules)
            if problem:
                yield f"{path} -> {included}: {problem}"


def link_violations(tree, modules):
    by_target = {module.replace("/", "_"): module for module in modules}
    linked = {}
    for file, module, links in tree.libraries():
        if module not in modules:
            yield f"{file} -> {module}: belongs to no module of tests/layering/layering.py"
            continue
        linked[module] = [by_target[link] for link in links if link in by_target]
        for link in links:
            if link in by_target and by_target[link] not in below(module, modules):
                yield f"{file} -> {link}: {module} must not know {by_target[link]}"
            for what, _, targets, allowed in EXTERNAL:
                if re.match(targets, link) and module not in allowed:
                    yield f"{file} -> {link}: {module} must not know {what}"
    # What is included must also be linked, else the order of the libraries holds by luck.
    linked = {module: linked.get(module, []) for module in modules}
    for path, lines in tree.includes.items():
        home = module_of(path, modules)
        if is_test(path) or home in (None, "server"):
            continue
        for _, included in lines:
            target = module_of(included, modules) if included in tree.includes else None
            if target in (None, "proto/depthtween") or target not in below(home, modules):
                continue
            if target not in below(home, linked):
                yield f"{path} -> {included}: DEPS of {home} do not reach {target}"


def cycles(tree):
    """Each cycle of includes once, from its first file in alphabetical order."""
    state, trail = {}, []

    def visit(path):
        state[path] = "open"
        trail.append(path)
        for _, included in tree.includes[path]:
            if included not in tree.includes:
                continue
            if state.get(included) == "open":
                ring = trail[trail.index(included):] + [included]
                yield f"{' -> '.join(ring)}: a cycle of includes"
            elif included not in state:
                yield from visit(included)
        trail.pop()
        state[path] = "done"

    for path in sorted(tree.includes):
        if path not in state:
            yield from visit(path)


def violations(root, modules=None):
    """Every wrong edge under `root`, as "from -> to: why"."""
    modules = MODULES if modules is None else modules
    tree = Tree(root)
    return [*include_violations(tree, modules), *link_violations(tree, modules), *cycles(tree)]
