// Uploads on disks that fail, of the database or of the files, at every I/O.
//
// How the truth is known: the client has the bytes. What it was told to be committed must be on the disk, byte by byte,
// after a power cut as well; and a client that goes on from where it is told ends with the whole file and its
// checksums.
#include <iostream>
#include <random>

#include "absl/strings/str_format.h"
#include "proto/depthtween/crc32c.h"
#include "server/jobs/sequences.h"
#include "server/store/sqlite_store.h"
#include "tests/server/server_fixtures.h"
#include "tests/server/store/faults/faulty_blobs.h"
#include "tests/server/store/faults/faulty_disk.h"

namespace depthtween::server {
namespace {

constexpr char kUploadFile[] = "/uploads.sqlite";

std::string HashOf(std::string_view bytes) {
  Sha256 hash;
  hash.Update(bytes);
  return hash.Finish();
}

class UploadFaults : public testing::Test {
 protected:
  // One client with an upload of three files.
  struct Client {
    std::string sequence, upload;
    std::vector<std::string> files;
    std::string bytes;      // of all files
    int64_t committed = 0;  // as it was told
    std::unique_ptr<UploadWriter> writer;
    int64_t sent = 0;
    bool finished = false;
  };

  void OpenStore() {
    for (Client& client : clients_) client.writer.reset();
    sequences_.reset();
    store_.reset();
    store_ = Take(OpenSqliteStore(kUploadFile, {}, /*checkpoint_pages=*/12));
    sequences_ = std::make_unique<Sequences>(*store_, blobs_, [] {});
  }

  void StartClients() {
    clients_ = std::vector<Client>(2);
    OpenStore();
    for (Client& client : clients_) {
      client.sequence = Take(sequences_->Create(kTenant, "", "")).id;
      std::vector<UploadFile> manifest;
      for (const size_t size : {700, 0, 900}) {
        std::string content(size, ' ');
        for (char& c : content) c = static_cast<char>(random_());
        manifest.push_back({.path = absl::StrCat("rgb/", manifest.size()),
                            .size_bytes = static_cast<int64_t>(size),
                            .sha256 = HashOf(content)});
        client.bytes += content;
        client.files.push_back(std::move(content));
      }
      client.upload = Take(sequences_->StartUpload(kTenant, client.sequence, manifest, "")).id;
    }
  }

  // What was told is there.
  void CheckCommitted() {
    for (Client& client : clients_) {
      const UploadRecord record = Take(sequences_->GetUpload(kTenant, client.sequence, client.upload));
      EXPECT_GE(record.committed_size, client.committed);
      EXPECT_TRUE(record.finished || !client.finished);
      std::string there;
      for (size_t i = 0; i < client.files.size(); ++i) {
        std::string content = blobs_.Content(client.sequence, absl::StrCat("rgb/", i));
        content.resize(std::min(content.size(), client.files[i].size()));
        there += content;
        if (content.size() < client.files[i].size()) break;
      }
      ASSERT_GE(static_cast<int64_t>(there.size()), record.committed_size);
      const auto committed = static_cast<size_t>(record.committed_size);
      EXPECT_EQ(there.substr(0, committed), client.bytes.substr(0, committed));
      client.committed = record.committed_size;
    }
  }

  // The next step of a client, which takes up its upload anew after an error. Whether that went well.
  absl::Status Step(Client& client) {
    if (client.finished) return absl::OkStatus();
    absl::Status status = [&]() -> absl::Status {
      if (client.writer == nullptr) {
        ASSIGN_OR_RETURN(const UploadRecord record, sequences_->GetUpload(kTenant, client.sequence, client.upload));
        client.committed = client.sent = record.committed_size;
        client.finished = record.finished;
        if (client.finished) return absl::OkStatus();
        ASSIGN_OR_RETURN(client.writer, sequences_->OpenUpload(kTenant, client.sequence, client.upload));
        return absl::OkStatus();
      }
      if (client.sent == static_cast<int64_t>(client.bytes.size())) {
        RETURN_IF_ERROR(client.writer->Finish().status());
        client.finished = true;
        client.committed = client.sent;
      } else if (random_() % 3 == 0) {
        ASSIGN_OR_RETURN(const UploadRecord record, client.writer->Close());
        client.committed = record.committed_size;
        client.writer.reset();
      } else {
        const std::string piece = client.bytes.substr(static_cast<size_t>(client.sent), 1 + random_() % 400);
        RETURN_IF_ERROR(client.writer->Write(client.sent, piece, Crc32c(piece)));
        client.sent += static_cast<int64_t>(piece.size());
      }
      return absl::OkStatus();
    }();
    if (!status.ok()) client.writer.reset();
    return status;
  }

  // Two clients in turns; at one point of it the fault. False if the fault came too late.
  template <typename Disk>
  void Run(Disk& disk, FaultKind kind, int64_t n, bool cut_power) {
    StartClients();
    disk.Arm(kind, n, /*lasts=*/n % 2 == 1);
    int errors = 0;
    for (int step = 0; step < 400; ++step) {
      Client& client = clients_[random_() % clients_.size()];
      const absl::Status status = Step(client);
      if (!status.ok()) {
        EXPECT_TRUE(disk.struck()) << status;
        const bool full = kind == FaultKind::kFull || kind == FaultKind::kShortWrite;
        if (full) {
          EXPECT_THAT(status, HasReason(absl::StatusCode::kResourceExhausted, "DISK_FULL"));
        } else {
          EXPECT_TRUE(absl::IsInternal(status) || absl::IsUnavailable(status)) << status;
        }
        if (++errors == 3) disk.Repair();
      }
      if (kind == FaultKind::kPowerCut ? errors == 2 : cut_power && errors > 0 && random_() % 4 == 0) {
        disk_.CutPower();
        blobs_.CutPower();
        OpenStore();
        CheckCommitted();
        errors = 3;
        cut_power = false;
        kind = FaultKind::kFull;
        if (HasFatalFailure()) return;
      }
    }
    disk.Repair();
    for (Client& client : clients_) {
      while (!client.finished) ASSERT_THAT(Step(client), IsOk());
    }
    disk_.CutPower();
    blobs_.CutPower();
    OpenStore();
    CheckCommitted();
    for (const Client& client : clients_) {
      const std::vector<FileChecksum> checksums = Take(store_->SequenceFiles(client.sequence));
      ASSERT_EQ(checksums.size(), client.files.size());
      for (size_t i = 0; i < checksums.size(); ++i) EXPECT_TRUE(Matches(checksums[i], client.files[i])) << i;
    }
  }

  template <typename Disk>
  int RunAll(Disk& disk, int max_points) {
    int faults = 0;
    for (const FaultKind kind : kFaultKinds) {
      int64_t n = 0;
      for (int point = 0; point < max_points; ++point) {
        SCOPED_TRACE(absl::StrFormat("%s at I/O %d", std::string(ToString(kind)), n));
        Run(disk, kind, n, /*cut_power=*/point % 2 == 0);
        if (HasFailure()) return faults;
        if (!disk.struck()) break;
        ++faults;
        n += 1 + n / 12;
      }
    }
    return faults;
  }

  std::minstd_rand random_{1};
  FaultyDisk disk_{/*seed=*/1};
  FaultyBlobs blobs_{/*seed=*/1};
  std::unique_ptr<Store> store_;
  std::vector<Client> clients_;
  std::unique_ptr<Sequences> sequences_;
};

TEST_F(UploadFaults, OfFiles) { std::cout << RunAll(blobs_, 40) << " faults\n"; }
TEST_F(UploadFaults, OfTheDatabase) { std::cout << RunAll(disk_, 40) << " faults\n"; }

}  // namespace
}  // namespace depthtween::server
