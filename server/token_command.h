// `depthtween-server token new | list | revoke`: the operator's way to make and end bearer tokens.
#ifndef DEPTHTWEEN_SERVER_TOKEN_COMMAND_H_
#define DEPTHTWEEN_SERVER_TOKEN_COMMAND_H_

#include <CLI/CLI.hpp>
#include <string>

#include "core/base/status.h"

namespace depthtween::server {

struct TokenOptions {
  std::string file;
  std::string tenant;
  std::string scopes;
  std::string lifetime;  // empty: for ever
  std::string id;        // of the token to revoke
};

// `options` must outlive the parsing.
CLI::App* AddTokenCommand(CLI::App& app, TokenOptions& options);
// Carries out the subcommand that was parsed, and prints. InvalidArgument for values that cannot be meant.
absl::Status RunTokenCommand(const CLI::App& command, const TokenOptions& options);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_TOKEN_COMMAND_H_
