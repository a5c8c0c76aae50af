// Runs the jobs of a data folder until it is killed:  manager_process DATA_DIR CORE_PROGRAM WORKERS
#include <unistd.h>

#include <cstdio>
#include <cstdlib>

#include "server/jobs/job_manager.h"
#include "server/store/sqlite_store.h"

using namespace depthtween::server;

int main(int argc, char** argv) {
  if (argc != 4) return 2;
  const auto directory = DataDirectory::Open(argv[1]);
  if (!directory.ok()) return 3;
  const auto store = OpenSqliteStore((*directory)->DatabaseFile(), {});
  if (!store.ok()) return 4;
  const auto manager =
      JobManager::Start(**directory, **store, {.core_program = argv[2], .workers = std::atoi(argv[3])});
  if (!manager.ok()) return 5;
  while (true) pause();
}
