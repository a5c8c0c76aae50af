#include "server/token_command.h"

#include <vector>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "server/access/token_file.h"

namespace depthtween::server {
namespace {

std::string Day(absl::Time time) {
  if (time == absl::InfiniteFuture()) return "never";
  return absl::FormatTime("%Y-%m-%d %H:%M UTC", time, absl::UTCTimeZone());
}

absl::Status MakeToken(const TokenOptions& options) {
  NewToken token = {.tenant = options.tenant};
  ASSIGN_OR_RETURN(token.scopes, ParseScopes(options.scopes));
  if (!options.lifetime.empty()) {
    ASSIGN_OR_RETURN(token.lifetime, ParseLifetime(options.lifetime));
  }
  ASSIGN_OR_RETURN(const std::string secret, AddToken(options.file, token));
  ASSIGN_OR_RETURN(const std::vector<Token> tokens, ReadTokenFile(options.file));
  for (const Token& made : tokens) {
    if (made.sha256 != HashOfSecret(secret)) continue;
    absl::PrintF("token %s of tenant %s, scopes %s, expires %s\n", made.id, made.tenant, JoinScopes(made.scopes),
                 Day(made.expire_time));
  }
  absl::PrintF("the secret, which is shown only now and stored nowhere:\n%s\n", secret);
  return absl::OkStatus();
}

absl::Status ListTokens(const TokenOptions& options) {
  ASSIGN_OR_RETURN(const std::vector<Token> tokens, ReadTokenFile(options.file));
  absl::PrintF("%-18s%-22s%-18s%-22s%s\n", "ID", "TENANT", "SCOPES", "MADE", "EXPIRES");
  const absl::Time now = absl::Now();
  for (const Token& token : tokens) {
    absl::PrintF("%-18s%-22s%-18s%-22s%s%s\n", token.id, token.tenant, JoinScopes(token.scopes), Day(token.create_time),
                 Day(token.expire_time), token.expire_time <= now ? " (expired)" : "");
  }
  return absl::OkStatus();
}

}  // namespace

CLI::App* AddTokenCommand(CLI::App& app, TokenOptions& options) {
  CLI::App* command = app.add_subcommand("token", "Make, list and revoke the tokens that let clients in.");
  command->require_subcommand(1);
  const auto add = [&](const char* name, const char* help) {
    CLI::App* part = command->add_subcommand(name, help);
    part->add_option("--tokens", options.file, "The token file that 'serve --tokens' is given")
        ->required()
        ->type_name("FILE");
    return part;
  };
  CLI::App* make = add("new", "Make a token. The secret is printed alone on the last line; the file keeps its hash.");
  make->add_option("--tenant", options.tenant, "Whose recordings and jobs the token opens; others do not exist for it")
      ->required()
      ->type_name("NAME");
  make->add_option("--scopes", options.scopes, "What it allows, joined by commas: read, write, admin")
      ->required()
      ->type_name("LIST");
  make->add_option("--expires", options.lifetime,
                   "How long it is valid, such as 30d, 12h or 45m; for ever if not given")
      ->type_name("TIME");
  add("list", "List the tokens: ids, tenants, scopes, when they expire. Secrets are not known.");
  add("revoke", "End a token. A running server refuses it within a second or two.")
      ->add_option("id", options.id, "Of the token, as 'token list' shows it")
      ->required();
  return command;
}

absl::Status RunTokenCommand(const CLI::App& command, const TokenOptions& options) {
  if (command.got_subcommand("new")) return MakeToken(options);
  if (command.got_subcommand("list")) return ListTokens(options);
  RETURN_IF_ERROR(RevokeToken(options.file, options.id));
  absl::PrintF("token %s is revoked\n", options.id);
  return absl::OkStatus();
}

}  // namespace depthtween::server
