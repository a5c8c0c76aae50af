// What every Store must do, whatever it is made of. A store joins by INSTANTIATE_TEST_SUITE_P with a way to open it.
#ifndef DEPTHTWEEN_TESTS_SERVER_STORE_STORE_CONFORMANCE_H_
#define DEPTHTWEEN_TESTS_SERVER_STORE_STORE_CONFORMANCE_H_

#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "server/store/store.h"
#include "tests/server/server_fixtures.h"

namespace depthtween::server {

// Opens the store that lives in a folder, making it if there is none.
using StoreFactory = std::function<std::unique_ptr<Store>(const std::string& folder, const Limits& limits)>;

class StoreConformance : public testing::TestWithParam<StoreFactory> {
 protected:
  StoreConformance() { Open(); }

  void Open(const Limits& limits = {}) {
    store_.reset();
    store_ = GetParam()(folder_.path(), limits);
  }
  Store& store() { return *store_; }

  // A sequence with one finished upload of three bytes.
  SequenceRecord UploadedSequence();
  // A sequence that was validated.
  SequenceRecord ReadySequence();
  // The task of a sequence that is one file.
  Task ArchiveTask(const std::string& path, int64_t size_bytes);
  // A job of `intervals` intervals of two frames each that has been prepared, and runs.
  JobRecord PreparedJob(int intervals);
  // Claims with batches of `batch` intervals; a task of number 0 when there is none.
  Task Claim(int batch = 2);
  JobRecord Job(const std::string& id) { return Take(store().GetJob(kTenant, id)); }

 private:
  TemporaryFolder folder_;
  std::unique_ptr<Store> store_;
};

Recording SomeRecording();
JobPlan PlanOf(int intervals);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_TESTS_SERVER_STORE_STORE_CONFORMANCE_H_
