"""The alert rules and the dashboard in deploy/ name metrics and labels that the server has, and the dashboard shows every
metric. The truth are the names in server/telemetry/metrics.cc and the labels in the comments of metrics.h."""

import json
import pathlib
import re
import unittest

SOURCE = pathlib.Path(__file__).resolve().parents[3]
ALERTS = SOURCE / "deploy/prometheus/alerts.yml"
DASHBOARD = SOURCE / "deploy/grafana/depthtween.json"
OF_PROMETHEUS = {"instance", "job", "le"}


def metrics():
    """name -> counter, gauge or histogram."""
    code = (SOURCE / "server/telemetry/metrics.cc").read_text()
    found = re.findall(r'Build(Counter|Gauge|Histogram)\(\)\s*\.Name\("(\w+)"\)', code)
    return {name: kind.lower() for kind, name in found}


def series(known):
    """What Prometheus stores of them -> the metric."""
    ends = {"histogram": ("_bucket", "_sum", "_count")}
    return {name + end: name for name, kind in known.items() for end in ends.get(kind, ("",))}


def labels():
    """name -> its labels."""
    header = (SOURCE / "server/telemetry/metrics.h").read_text()
    return {name: set(names.split(",")) if names else set()
            for name, names in re.findall(r"(depthtween_[a-z_]+)(?:\{([a-z,]+)\})?", header)}


def expressions():
    """(where, the text of each query)."""
    found = [("alerts.yml", text) for text in re.findall(r"expr: (?:\|\n((?:\s{12,}.*\n| {10}\S.*\n)+)|(.*)\n)",
                                                         ALERTS.read_text())]
    found = [(where, block or line) for where, (block, line) in found]
    dashboard = json.loads(DASHBOARD.read_text())
    for panel in dashboard["panels"]:
        found += [(panel["title"], target["expr"]) for target in panel["targets"]]
    found += [(variable["name"], variable["query"]) for variable in dashboard["templating"]["list"]
              if variable["type"] == "query"]
    return found


class MetricNames(unittest.TestCase):

    def test_there_is_something_to_compare(self):
        self.assertGreater(len(metrics()), 10)
        self.assertEqual(set(metrics()), set(labels()), "metrics.cc and the comments of metrics.h")
        self.assertEqual(ALERTS.read_text().count("expr:"), sum(where == "alerts.yml" for where, _ in expressions()))

    def test_every_name_in_a_query_is_one_of_the_server(self):
        known = series(metrics())
        for where, text in expressions():
            for name in re.findall(r"\bdepthtween_\w+", text):
                self.assertIn(name, known, where)

    def test_every_label_is_one_of_its_metric(self):
        known, of = series(metrics()), labels()
        for where, text in expressions():
            for name, matchers in re.findall(r"\b(depthtween_\w+)\{([^}]*)\}", text):
                for label in re.findall(r'(\w+)\s*(?:=~|!~|!=|=)\s*"', matchers):
                    self.assertIn(label, of[known[name]] | OF_PROMETHEUS, f"{where}: {name}")
            used = {label for names in re.findall(r"\bby \(([^)]*)\)", text) for label in re.split(r",\s*", names)}
            possible = set().union(OF_PROMETHEUS, *(of[known[name]] for name in re.findall(r"\bdepthtween_\w+", text)))
            self.assertLessEqual(used, possible, where)

    def test_the_text_about_an_alert_names_only_metrics_of_the_server(self):
        for name in re.findall(r"\bdepthtween_\w+", ALERTS.read_text()):
            self.assertTrue(name in series(metrics()) or name in metrics(), name)

    def test_the_dashboard_shows_every_metric(self):
        known = series(metrics())
        shown = {known[name] for name in re.findall(r"\bdepthtween_\w+", DASHBOARD.read_text())}
        self.assertEqual(shown, set(metrics()))

    def test_alerts_watch_what_an_operator_must_know(self):
        known = series(metrics())
        watched = {known[name] for where, text in expressions() if where == "alerts.yml"
                   for name in re.findall(r"\bdepthtween_\w+", text)}
        self.assertLessEqual({"depthtween_ready", "depthtween_free_disk_bytes", "depthtween_tasks_total",
                              "depthtween_task_failures_total", "depthtween_queue_wait_seconds",
                              "depthtween_store_write_seconds", "depthtween_busy_workers"}, watched)

    def test_brackets_close(self):
        for where, text in expressions():
            for opening, closing in ("()", "{}", "[]"):
                self.assertEqual(text.count(opening), text.count(closing), f"{where}: {text}")


if __name__ == "__main__":
    unittest.main(verbosity=2)
