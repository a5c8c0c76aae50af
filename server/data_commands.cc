#include "server/data_commands.h"

#include <sys/stat.h>

#include <CLI/CLI.hpp>
#include <array>
#include <cstdint>
#include <cstdio>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "server/jobs/scrub.h"
#include "server/store/backup.h"

namespace depthtween::server {
namespace {

constexpr absl::Duration kProgressGap = absl::Seconds(1);

std::string Size(int64_t bytes) {
  constexpr std::array<const char*, 5> kUnits = {"B", "kB", "MB", "GB", "TB"};
  auto value = static_cast<double>(bytes);
  size_t unit = 0;
  for (; value >= 1000.0 && unit + 1 < kUnits.size(); ++unit) value /= 1000.0;
  return absl::StrFormat("%.*f %s", unit == 0 ? 0 : 1, value, kUnits.at(unit));
}

// Says on standard error how far it is, once a second.
OnCopied Teller() {
  return [next = absl::Now() + kProgressGap](const CopyProgress& progress) mutable {
    if (absl::Now() < next) return;
    next = absl::Now() + kProgressGap;
    absl::FPrintF(stderr, "%d of %d files, %s of %s\n", progress.files, progress.files_total, Size(progress.bytes),
                  Size(progress.bytes_total));
  };
}

absl::Status Backup(const std::string& data_dir, const std::string& to, const std::string& link_unchanged_from) {
  ASSIGN_OR_RETURN(const BackupSummary summary,
                   MakeBackup(data_dir, to, {.link_unchanged_from = link_unchanged_from, .on_copied = Teller()}));
  for (const std::string& fault : summary.faults) absl::FPrintF(stderr, "%s\n", fault);
  absl::PrintF("%s: %d recordings, %d jobs, %d files, %s\n", to, summary.sequences, summary.jobs, summary.files,
               Size(summary.bytes));
  if (!link_unchanged_from.empty()) {
    absl::PrintF("%d of the files are shared with %s\n", summary.linked_files, link_unchanged_from);
  }
  if (summary.faults.empty()) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat("the backup is made, but ", summary.faults.size(), " files of ", data_dir,
                                          " were not as the database has them"));
}

absl::Status Restore(const std::string& from, const std::string& data_dir) {
  ASSIGN_OR_RETURN(const RestoreSummary summary, RestoreBackup(from, data_dir, Teller()));
  absl::PrintF("%s: %d files, %s, all as they were backed up\n", data_dir, summary.files, Size(summary.bytes));
  return absl::OkStatus();
}

absl::Status CheckFiles(const std::string& data_dir) {
  absl::Time next = absl::Now() + kProgressGap;
  ASSIGN_OR_RETURN(const ScrubSummary summary, ScrubFolder(data_dir, {.on_files = [&next](const ScrubSummary& so_far) {
                                                             if (absl::Now() < next) return;
                                                             next = absl::Now() + kProgressGap;
                                                             absl::FPrintF(stderr, "%d files, %s\n", so_far.files,
                                                                           Size(so_far.bytes));
                                                           }}));
  for (const FileFault& fault : summary.faults) absl::PrintF("%s: %s\n", fault.path, fault.what);
  absl::PrintF("%d files, %s checked; %d damaged or missing; %d without a checksum\n", summary.files,
               Size(summary.bytes), summary.faults.size(), summary.unknown_files);
  if (summary.faults.empty()) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat(summary.faults.size(), " files of ", data_dir, " are damaged or missing"));
}

}  // namespace

struct DataCommands::Options {
  std::string data_dir;
  std::string to;
  std::string from;
  std::string link_unchanged_from;
};

DataCommands::DataCommands(CLI::App& app) : app_(app), options_(std::make_unique<Options>()) {
  CLI::App* backup = app.add_subcommand(
      "backup", "Copy a data folder, also while a server works in it. Exits with 1 if a file is lost or damaged.");
  backup->add_option("--data-dir", options_->data_dir, "The folder to copy")->required();
  backup->add_option("--to", options_->to, "Folder to make: a data folder with a list of its files, backup.sha256")
      ->required();
  backup->add_option("--link-unchanged-from", options_->link_unchanged_from,
                     "An earlier backup on the same disk: files that have not changed since are shared with it");
  CLI::App* restore = app.add_subcommand("restore", "Make a data folder from a backup, and check every byte of it.");
  restore->add_option("--from", options_->from, "The backup")->required();
  restore->add_option("--data-dir", options_->data_dir, "The folder to make; must be missing or empty")->required();
  CLI::App* scrub = app.add_subcommand(
      "scrub",
      "Read all stored files and list those that are damaged, also while a server works in the folder. Exits with 1 if "
      "there are any; changes nothing.");
  scrub->add_option("--data-dir", options_->data_dir, "The folder to look at")->required();
}

DataCommands::~DataCommands() = default;

std::optional<absl::Status> DataCommands::Run() const {
  umask(0077);  // recordings are nobody else's to read
  if (app_.got_subcommand("backup")) return Backup(options_->data_dir, options_->to, options_->link_unchanged_from);
  if (app_.got_subcommand("restore")) return Restore(options_->from, options_->data_dir);
  if (app_.got_subcommand("scrub")) return CheckFiles(options_->data_dir);
  return std::nullopt;
}

}  // namespace depthtween::server
