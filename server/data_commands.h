// The commands of depthtween-server that look after a data folder: backup, restore and scrub.
#ifndef DEPTHTWEEN_SERVER_DATA_COMMANDS_H_
#define DEPTHTWEEN_SERVER_DATA_COMMANDS_H_

#include <memory>
#include <optional>

#include "core/base/status.h"

namespace CLI {
class App;
}

namespace depthtween::server {

// Threads: one.
class DataCommands {
 public:
  explicit DataCommands(CLI::App& app);
  ~DataCommands();
  DataCommands(const DataCommands&) = delete;
  DataCommands& operator=(const DataCommands&) = delete;

  // After `app` has parsed: runs the command that was given and returns how it ended; nullopt if it is none of these.
  // Results go to standard output, progress to standard error.
  std::optional<absl::Status> Run() const;

 private:
  struct Options;
  CLI::App& app_;
  const std::unique_ptr<Options> options_;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_DATA_COMMANDS_H_
