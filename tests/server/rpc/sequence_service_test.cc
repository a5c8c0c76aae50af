// Uploads over a real connection: what is stored must be what was sent, whatever went wrong on the way.
#include <algorithm>
#include <random>
#include <set>

#include "proto/depthtween/crc32c.h"
#include "tests/server/rpc/rpc_fixture.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;
using testing::Not;

class SequenceServiceTest : public RpcTest {
 protected:
  grpc::Status Create(const std::string& display_name, const std::string& request_id, v1::Sequence* sequence) {
    grpc::ClientContext context;
    v1::CreateSequenceRequest request;
    request.mutable_sequence()->set_display_name(display_name);
    request.set_request_id(request_id);
    return sequences_stub().CreateSequence(&context, request, sequence);
  }
  grpc::Status Get(const std::string& name, v1::Sequence* sequence) {
    grpc::ClientContext context;
    v1::GetSequenceRequest request;
    request.set_name(name);
    return sequences_stub().GetSequence(&context, request, sequence);
  }
  grpc::Status Delete(const std::string& name) {
    grpc::ClientContext context;
    v1::DeleteSequenceRequest request;
    request.set_name(name);
    google::protobuf::Empty response;
    return sequences_stub().DeleteSequence(&context, request, &response);
  }
  grpc::Status Commit(const std::string& name, v1::Sequence* sequence) {
    grpc::ClientContext context;
    v1::CommitSequenceRequest request;
    request.set_name(name);
    return sequences_stub().CommitSequence(&context, request, sequence);
  }
  grpc::Status List(int page_size, const std::string& token, const std::string& filter,
                    v1::ListSequencesResponse* response) {
    grpc::ClientContext context;
    v1::ListSequencesRequest request;
    request.set_page_size(page_size);
    request.set_page_token(token);
    request.set_filter(filter);
    return sequences_stub().ListSequences(&context, request, response);
  }
  grpc::Status Announce(const std::string& parent, const v1::Upload& upload, const std::string& request_id = "") {
    grpc::ClientContext context;
    v1::StartUploadRequest request;
    request.set_parent(parent);
    *request.mutable_upload() = upload;
    request.set_request_id(request_id);
    v1::Upload response;
    return sequences_stub().StartUpload(&context, request, &response);
  }
  grpc::Status GetUpload(const std::string& name, v1::Upload* upload) {
    grpc::ClientContext context;
    v1::GetUploadRequest request;
    request.set_name(name);
    return sequences_stub().GetUpload(&context, request, upload);
  }
  // One stream of exactly these messages.
  grpc::Status Write(const std::vector<v1::WriteUploadRequest>& messages, v1::Upload* response) {
    grpc::ClientContext context;
    const auto writer = sequences_stub().WriteUpload(&context, response);
    for (const v1::WriteUploadRequest& message : messages) {
      if (!writer->Write(message)) break;
    }
    writer->WritesDone();
    return writer->Finish();
  }
};

v1::Upload Manifest(const std::string& path, int64_t size_bytes) {
  v1::Upload upload;
  upload.add_files()->set_path(path);
  upload.mutable_files(0)->set_size_bytes(size_bytes);
  return upload;
}

v1::WriteUploadRequest Message(const std::string& name, int64_t offset, const std::string& data) {
  v1::WriteUploadRequest message;
  message.set_name(name);
  message.set_write_offset(offset);
  message.set_data(data);
  message.set_crc32c(Crc32c(data));
  return message;
}

TEST_F(SequenceServiceTest, CreateGetDelete) {
  v1::Sequence created, read;
  ASSERT_THAT(Create("hands", "", &created), Succeeds());
  EXPECT_EQ(created.name().rfind("sequences/", 0), 0U);
  EXPECT_EQ(created.state(), v1::Sequence::STATE_UPLOADING);
  EXPECT_GT(created.create_time().seconds(), 0);
  ASSERT_THAT(Get(created.name(), &read), Succeeds());
  EXPECT_EQ(read.SerializeAsString(), created.SerializeAsString());
  EXPECT_EQ(read.display_name(), "hands");
  EXPECT_THAT(Delete(created.name()), Succeeds());
  EXPECT_THAT(Get(created.name(), &read), Fails(grpc::NOT_FOUND, "NO_SUCH_RESOURCE"));
}

// AIP-155: the same request_id with the same request is the same request; with another one it is a mistake.
TEST_F(SequenceServiceTest, RequestIdMakesCreationIdempotent) {
  v1::Sequence first, again, other;
  ASSERT_THAT(Create("hands", "r1", &first), Succeeds());
  ASSERT_THAT(Create("hands", "r1", &again), Succeeds());
  EXPECT_EQ(again.name(), first.name());
  EXPECT_THAT(Create("feet", "r1", &other), Fails(grpc::ALREADY_EXISTS, "IDEMPOTENCY_MISMATCH"));
  ASSERT_THAT(Create("hands", "", &other), Succeeds());
  EXPECT_NE(other.name(), first.name());
  EXPECT_THAT(Create("hands", std::string(129, 'r'), &other), FailsAtField("request_id"));
  EXPECT_THAT(Create(std::string(201, 'x'), "", &other), FailsAtField("sequence.display_name"));
}

TEST_F(SequenceServiceTest, MalformedNamesAreNamed) {
  v1::Sequence sequence;
  v1::Upload upload;
  for (const std::string name : {"", "x", "sequences", "sequences/", "sequences/..", "sequences/a/b", "jobs/1",
                                 "sequences/../../etc/passwd", "/sequences/1", "sequences/1/uploads/2"}) {
    EXPECT_THAT(Get(name, &sequence), FailsAtField("name")) << name;
    EXPECT_THAT(Delete(name), FailsAtField("name")) << name;
    EXPECT_THAT(Commit(name, &sequence), FailsAtField("name")) << name;
    EXPECT_THAT(Announce(name, Manifest("a", 1)), FailsAtField("parent")) << name;
  }
  EXPECT_THAT(GetUpload("sequences/1", &upload), FailsAtField("name"));
  EXPECT_THAT(Write({Message("sequences/1", 0, "x")}, &upload), FailsAtField("name"));
}

TEST_F(SequenceServiceTest, UnknownIdsAreNotFound) {
  v1::Sequence sequence;
  v1::Upload upload;
  const std::string name = "sequences/0123456789abcdef";
  const std::string upload_name = name + "/uploads/0123456789abcdef";
  for (const grpc::Status& status :
       {Get(name, &sequence), Delete(name), Commit(name, &sequence), Announce(name, Manifest("a", 1))}) {
    EXPECT_THAT(status, Fails(grpc::NOT_FOUND, "NO_SUCH_RESOURCE"));
    const auto resource = Detail<google::rpc::ResourceInfo>(status);
    ASSERT_TRUE(resource.has_value());
    EXPECT_EQ(resource->resource_type(), "depthtween/Sequence");
    EXPECT_EQ(resource->resource_name(), name);
  }
  for (const grpc::Status& status : {GetUpload(upload_name, &upload), Write({Message(upload_name, 0, "x")}, &upload)}) {
    EXPECT_THAT(status, Fails(grpc::NOT_FOUND, "NO_SUCH_RESOURCE"));
    EXPECT_EQ(Detail<google::rpc::ResourceInfo>(status)->resource_type(), "depthtween/Upload");
  }
  // An upload is found under its own sequence only.
  const v1::Upload real = StartUpload(CreateSequence().name(), {{"a", "x"}});
  const std::string elsewhere = CreateSequence().name() + real.name().substr(real.name().find("/uploads/"));
  EXPECT_THAT(GetUpload(elsewhere, &upload), Fails(grpc::NOT_FOUND, "NO_SUCH_RESOURCE"));
}

// Pages are disjoint, newest first, and together they are everything; a token belongs to its list and filter.
TEST_F(SequenceServiceTest, PagesCoverTheList) {
  std::vector<std::string> made;
  for (int i = 0; i < 5; ++i) made.push_back(CreateSequence().name());
  std::reverse(made.begin(), made.end());
  std::vector<std::string> listed;
  std::string token;
  do {
    v1::ListSequencesResponse page;
    ASSERT_THAT(List(2, token, "state = UPLOADING", &page), Succeeds());
    EXPECT_LE(page.sequences_size(), 2);
    for (const auto& sequence : page.sequences()) listed.push_back(sequence.name());
    token = page.next_page_token();
  } while (!token.empty());
  EXPECT_EQ(listed, made);

  v1::ListSequencesResponse page;
  ASSERT_THAT(List(2, "", "state = UPLOADING", &page), Succeeds());
  v1::ListSequencesResponse other;
  EXPECT_THAT(List(2, page.next_page_token(), "", &other), FailsAtField("page_token"));
  EXPECT_THAT(List(2, "garbage", "", &other), FailsAtField("page_token"));
  EXPECT_THAT(List(-1, "", "", &other), FailsAtField("page_size"));
  EXPECT_THAT(List(1 << 30, "", "", &other), Succeeds());
  EXPECT_EQ(other.sequences_size(), 5);
}

TEST_F(SequenceServiceTest, FiltersAreUnderstoodOrExplained) {
  CreateSequence();
  v1::ListSequencesResponse page;
  ASSERT_THAT(List(0, "", "state=\"READY\"", &page), Succeeds());
  EXPECT_EQ(page.sequences_size(), 0);
  for (const std::string filter : {"state", "state = SLEEPING", "colour = red", "state = READY OR state = INVALID"}) {
    EXPECT_THAT(List(0, "", filter, &page), FailsAtField("filter")) << filter;
  }
}

// Names that would leave the sequence's folder, hide, or confuse a shell or a log are refused before anything is made.
TEST_F(SequenceServiceTest, PathsThatLeaveTheSequenceAreRefused) {
  const std::string sequence = CreateSequence().name();
  for (const std::string path : {"", "..", "../a", "a/../../b", "/etc/passwd", "a//b", "a/", ".hidden", "rgb/.a",
                                 "a\\b", "a\nb", "a/b/c/d/e/f", "C:/a", "rgb/\x7f"}) {
    const grpc::Status status = Announce(sequence, Manifest(path, 1));
    EXPECT_EQ(status.error_code(), grpc::INVALID_ARGUMENT) << path << ": " << status.error_message();
    EXPECT_TRUE(Detail<google::rpc::BadRequest>(status).has_value()) << path;
  }
  EXPECT_THAT(Announce(sequence, Manifest(std::string(300, 'a'), 1)), FailsAtField("upload.files.path"));
}

TEST_F(SequenceServiceTest, ManifestsAreCheckedBeforeBytesFlow) {
  limits.max_sequence_bytes = 1000;
  const std::string sequence = CreateSequence().name();
  EXPECT_THAT(Announce(sequence, v1::Upload()), FailsAtField("upload.files"));
  EXPECT_THAT(Announce(sequence, Manifest("a", -1)), FailsAtField("upload.files.size_bytes"));
  v1::Upload wrong_sum = Manifest("a", 10);
  wrong_sum.set_size_bytes(11);
  EXPECT_THAT(Announce(sequence, wrong_sum), FailsAtField("upload.size_bytes"));
  const grpc::Status too_large = Announce(sequence, Manifest("a", 1001));
  EXPECT_THAT(too_large, Fails(grpc::RESOURCE_EXHAUSTED, "LIMIT_EXCEEDED"));
  EXPECT_EQ(Detail<google::rpc::QuotaFailure>(too_large)->violations(0).subject(), "max_sequence_bytes");
  v1::Upload overflow = Manifest("a", INT64_MAX);
  *overflow.add_files() = Manifest("b", INT64_MAX).files(0);
  EXPECT_THAT(Announce(sequence, overflow), Fails(grpc::RESOURCE_EXHAUSTED, "LIMIT_EXCEEDED"));
  EXPECT_THAT(Announce(sequence, Manifest("a", 10), "u1"), Succeeds());
  EXPECT_THAT(Announce(sequence, Manifest("a", 10), "u1"), Succeeds());
  EXPECT_THAT(Announce(sequence, Manifest("a", 11), "u1"), Fails(grpc::ALREADY_EXISTS, "IDEMPOTENCY_MISMATCH"));
  EXPECT_THAT(Announce(sequence, Manifest("a", 10)), Fails(grpc::ALREADY_EXISTS, "DUPLICATE_PATH"));
}

// The promise of a resumable upload: cut at any byte, go on at committed_size, and the files hold what was sent.
TEST_F(SequenceServiceTest, AnUploadCutAtARandomByteResumesToTheByte) {
  const std::map<std::string, std::string> files = {{"camera.json", "{}"},
                                                    {"depth/000000.png", RandomBytes(70'001, 1)},
                                                    {"empty.txt", ""},
                                                    {"rgb/000000.png", RandomBytes(150'000, 2)}};
  const std::string bytes = Concatenate(files);
  for (const unsigned seed : {1U, 2U, 3U, 4U}) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    const std::string sequence = CreateSequence().name();
    const std::string name = StartUpload(sequence, files).name();
    // Several cuts, some right at the start; each in the middle of a stream.
    v1::Upload upload;
    for (int cut = 0; cut < 3; ++cut) {
      ASSERT_THAT(GetUpload(name, &upload), Succeeds());
      const size_t from = upload.committed_size();
      const size_t to = from + random() % (bytes.size() - from);
      grpc::ClientContext context;
      v1::Upload ignored;
      const auto writer = sequences_stub().WriteUpload(&context, &ignored);
      size_t at = from;
      while (at < to) {
        const size_t size = std::min<size_t>(1 + random() % 40'000, to - at);
        if (!writer->Write(Message(name, static_cast<int64_t>(at), bytes.substr(at, size)))) break;
        at += size;
      }
      if (cut == 0) {
        writer->WritesDone();  // a client that goes in order loses nothing
        EXPECT_THAT(writer->Finish(), Succeeds());
        ASSERT_THAT(GetUpload(name, &upload), Succeeds());
        EXPECT_EQ(upload.committed_size(), static_cast<int64_t>(to));
      } else {
        context.TryCancel();
        EXPECT_FALSE(writer->Finish().ok());
      }
    }
    // A stream that was cut may still be writing what it had received: the next one takes over, and is told where it
    // stands if it guessed wrong.
    grpc::Status status;
    do {
      ASSERT_THAT(GetUpload(name, &upload), Succeeds());
      status = WriteUpload(name, bytes, upload.committed_size(), 30'000, /*finish=*/true, &upload);
    } while (status.error_code() == grpc::OUT_OF_RANGE);
    ASSERT_THAT(status, Succeeds());
    EXPECT_EQ(upload.state(), v1::Upload::STATE_FINISHED);
    EXPECT_EQ(upload.committed_size(), static_cast<int64_t>(bytes.size()));
    for (const auto& [path, content] : files) {
      EXPECT_EQ(ReadText(directory().SequenceFolder(IdOf(sequence)) + "/" + path), content) << path;
    }
  }
}

TEST_F(SequenceServiceTest, DamagedBytesAreRefusedAndNothingOfThemIsKept) {
  const std::string name = StartUpload(CreateSequence().name(), {{"a", "0123456789"}}).name();
  v1::WriteUploadRequest damaged = Message(name, 4, "4567");
  damaged.set_crc32c(damaged.crc32c() ^ 1U);
  v1::Upload upload;
  const grpc::Status status = Write({Message(name, 0, "0123"), damaged}, &upload);
  EXPECT_THAT(status, Fails(grpc::DATA_LOSS, "CHECKSUM_MISMATCH"));
  EXPECT_EQ(Detail<google::rpc::ErrorInfo>(status)->metadata().at("committed_size"), "4");
  ASSERT_THAT(GetUpload(name, &upload), Succeeds());
  EXPECT_EQ(upload.committed_size(), 4);
  v1::WriteUploadRequest unchecked = Message(name, 4, "4567");
  unchecked.clear_crc32c();
  EXPECT_THAT(Write({unchecked}, &upload), FailsAtField("crc32c"));
  EXPECT_THAT(WriteUpload(name, "0123456789", 4, 3, /*finish=*/true, &upload), Succeeds());
}

TEST_F(SequenceServiceTest, AnUploadCanBeAbandoned) {
  v1::Sequence sequence;
  ASSERT_THAT(Create("", "", &sequence), Succeeds());
  const v1::Upload upload = StartUpload(sequence.name(), {{"a", "0123"}});
  EXPECT_GT(upload.expire_time().seconds(), upload.create_time().seconds());
  const auto abandon = [this](const std::string& name) {
    grpc::ClientContext context;
    v1::DeleteUploadRequest request;
    request.set_name(name);
    google::protobuf::Empty response;
    return sequences_stub().DeleteUpload(&context, request, &response);
  };
  EXPECT_THAT(Commit(sequence.name(), &sequence), Fails(grpc::FAILED_PRECONDITION, "WRONG_STATE"));
  EXPECT_THAT(abandon(upload.name()), Succeeds());
  EXPECT_THAT(abandon(upload.name()), Fails(grpc::NOT_FOUND, "NO_SUCH_RESOURCE"));
  EXPECT_THAT(abandon("uploads/x"), FailsAtField("name"));
  ASSERT_THAT(Get(sequence.name(), &sequence), Succeeds());
  EXPECT_EQ(sequence.file_count(), 0);
  v1::Upload finished = StartUpload(sequence.name(), {{"a", "0123"}});
  ASSERT_THAT(WriteUpload(finished.name(), "0123", 0, 4, /*finish=*/true, &finished), Succeeds());
  EXPECT_FALSE(finished.has_expire_time());
  EXPECT_THAT(abandon(finished.name()), Fails(grpc::FAILED_PRECONDITION, "WRONG_STATE"));
}

TEST_F(SequenceServiceTest, AWrongSha256CostsThatFileOnly) {
  const std::string sequence = CreateSequence().name();
  v1::Upload manifest = Manifest("a", 4);
  *manifest.add_files() = Manifest("b", 4).files(0);
  manifest.mutable_files(1)->set_sha256(std::string(32, 'x'));
  grpc::ClientContext context;
  v1::StartUploadRequest request;
  request.set_parent(sequence);
  *request.mutable_upload() = manifest;
  v1::Upload upload;
  ASSERT_THAT(sequences_stub().StartUpload(&context, request, &upload), Succeeds());
  v1::Upload response;
  const grpc::Status status = WriteUpload(upload.name(), "aaaabbbb", 0, 8, /*finish=*/true, &response);
  EXPECT_THAT(status, Fails(grpc::DATA_LOSS, "CHECKSUM_MISMATCH"));
  EXPECT_EQ(Detail<google::rpc::ErrorInfo>(status)->metadata().at("path"), "b");
  ASSERT_THAT(GetUpload(upload.name(), &upload), Succeeds());
  EXPECT_EQ(upload.committed_size(), 4);
}

TEST_F(SequenceServiceTest, AWrongOffsetIsToldWhereToGoOn) {
  const std::string name = StartUpload(CreateSequence().name(), {{"a", "0123456789"}}).name();
  v1::Upload upload;
  ASSERT_THAT(Write({Message(name, 0, "0123")}, &upload), Succeeds());
  EXPECT_EQ(upload.committed_size(), 4);
  for (const int64_t offset : {0, 3, 5, -1}) {
    const grpc::Status status = Write({Message(name, offset, "x")}, &upload);
    EXPECT_THAT(status, Fails(grpc::OUT_OF_RANGE, "OFFSET_MISMATCH")) << offset;
    EXPECT_EQ(Detail<google::rpc::ErrorInfo>(status)->metadata().at("committed_size"), "4");
  }
  EXPECT_THAT(Write({Message(name, 4, "4567890")}, &upload), Fails(grpc::OUT_OF_RANGE, "OFFSET_MISMATCH"));
}

TEST_F(SequenceServiceTest, StreamsThatMakeNoSenseAreExplained) {
  const std::string name = StartUpload(CreateSequence().name(), {{"a", "0123456789"}}).name();
  v1::Upload upload;
  EXPECT_THAT(Write({}, &upload), FailsAtField("name"));
  EXPECT_THAT(Write({Message(name, 0, "0123"), Message(name + "0", 4, "4")}, &upload), FailsAtField("name"));
  const grpc::Status too_large = Write({Message(name, 4, std::string((1 << 20) + 1, 'x'))}, &upload);
  EXPECT_THAT(too_large, Fails(grpc::RESOURCE_EXHAUSTED, "LIMIT_EXCEEDED"));
  EXPECT_EQ(Detail<google::rpc::QuotaFailure>(too_large)->violations(0).subject(), "max_chunk_bytes");
  v1::WriteUploadRequest finish;
  finish.set_name(name);
  finish.set_finish(true);
  EXPECT_THAT(Write({finish}, &upload), Fails(grpc::FAILED_PRECONDITION, "WRONG_STATE"));
  ASSERT_THAT(WriteUpload(name, "0123456789", 4, 99, /*finish=*/true, &upload), Succeeds());
  EXPECT_THAT(Write({Message(name, 10, "x")}, &upload), Fails(grpc::FAILED_PRECONDITION, "WRONG_STATE"));
}

// The older connection is usually dead without knowing: the newer one wins.
TEST_F(SequenceServiceTest, ANewerStreamTakesOver) {
  const std::string name = StartUpload(CreateSequence().name(), {{"a", "0123456789"}}).name();
  grpc::ClientContext older_context;
  v1::Upload older_response, upload;
  const auto older = sequences_stub().WriteUpload(&older_context, &older_response);
  ASSERT_TRUE(older->Write(Message(name, 0, "01")));
  // Until the older stream has written, the newer one might still come first.
  grpc::Status status;
  do {
    ASSERT_THAT(GetUpload(name, &upload), Succeeds());
    status = WriteUpload(name, "0123456789", upload.committed_size(), 99, /*finish=*/false, &upload);
  } while (!status.ok());
  older->Write(Message(name, 2, "23"));
  older->WritesDone();
  const grpc::Status older_status = older->Finish();
  EXPECT_TRUE(older_status.error_code() == grpc::ABORTED || older_status.error_code() == grpc::OUT_OF_RANGE)
      << older_status.error_message();
  ASSERT_THAT(GetUpload(name, &upload), Succeeds());
  EXPECT_EQ(upload.committed_size(), 10);
}

// A disk on which the right things are in the wrong place: each call then fails in its own system call, whose error
// names the file, and no client is told where on the server that is.
TEST_F(SequenceServiceTest, ErrorsNameNoPathOfTheServer) {
  const auto expect_hidden = [this](const grpc::Status& status, const std::string& named) {
    EXPECT_THAT(status.error_message(), HasSubstr(named));
    EXPECT_THAT(status.error_message(), Not(HasSubstr(directory().path())));
    EXPECT_THAT(status.error_details(), Not(HasSubstr(directory().path())));
  };
  const v1::Sequence sequence = CreateSequence();
  const v1::Upload upload = StartUpload(sequence.name(), {{"a/b", "bytes"}});
  WriteText(directory().path() + "/" + sequence.name(), "a file where a folder is to be");
  v1::Upload written;
  expect_hidden(WriteUpload(upload.name(), "bytes", 0, 5, /*finish=*/true, &written), "create " + sequence.name());

  std::filesystem::rename(directory().path() + "/trash", directory().path() + "/elsewhere");
  WriteText(directory().path() + "/trash", "a file where a folder is to be");
  expect_hidden(Delete(sequence.name()), sequence.name() + " is deleted, but its files stay");
  EXPECT_THAT(Delete(sequence.name()), Fails(grpc::NOT_FOUND, "NO_SUCH_RESOURCE"));
}

TEST_F(SequenceServiceTest, CommitNeedsFinishedUploads) {
  v1::Sequence sequence = CreateSequence();
  EXPECT_THAT(Commit(sequence.name(), &sequence), Fails(grpc::FAILED_PRECONDITION, "WRONG_STATE"));
  const v1::Upload upload = StartUpload(sequence.name(), {{"a", "0123"}});
  const grpc::Status status = Commit(sequence.name(), &sequence);
  EXPECT_THAT(status, Fails(grpc::FAILED_PRECONDITION, "WRONG_STATE"));
  const auto failure = Detail<google::rpc::PreconditionFailure>(status);
  ASSERT_TRUE(failure.has_value());
  EXPECT_EQ(failure->violations(0).subject(), sequence.name());
  EXPECT_THAT(failure->violations(0).description(), testing::HasSubstr(upload.name()));
}

TEST_F(SequenceServiceTest, ValidationSaysWhatItFound) {
  const v1::Sequence ready = ReadySequence();
  ASSERT_EQ(ready.state(), v1::Sequence::STATE_READY);
  EXPECT_EQ(ready.recording().camera().width(), 4);
  EXPECT_EQ(ready.recording().depth_scale(), 5000.0);
  EXPECT_EQ(ready.recording().color_frame_count(), 2);
  EXPECT_EQ(ready.recording().last_time_ns(), 20);
  EXPECT_THAT(ready.warnings(), testing::ElementsAre("fake"));

  const v1::Sequence invalid = ReadySequence("invalid");
  ASSERT_EQ(invalid.state(), v1::Sequence::STATE_INVALID);
  ASSERT_EQ(invalid.violations_size(), 1);
  EXPECT_EQ(invalid.violations(0).file(), "depth/0.png");
  EXPECT_EQ(invalid.violations(0).status().code(), grpc::DATA_LOSS);
  EXPECT_FALSE(invalid.has_recording());

  const v1::Sequence crashed = ReadySequence("crash_validate");
  ASSERT_EQ(crashed.state(), v1::Sequence::STATE_INVALID);
  EXPECT_EQ(crashed.violations_size(), 0);
  EXPECT_THAT(crashed.error().message(), testing::HasSubstr("SIGABRT"));
}

// A page that would not fit into the message a client takes is cut shorter; together the pages are still everything.
TEST_F(SequenceServiceTest, PagesStaySmallerThanAMessage) {
  limits.max_display_name_bytes = 1 << 20;
  for (int i = 0; i < 7; ++i) CreateSequence(std::string(1 << 20, 'a' + i));
  std::string token, seen;
  do {
    v1::ListSequencesResponse page;
    ASSERT_THAT(List(0, token, "", &page), Succeeds());
    EXPECT_LT(page.ByteSizeLong(), 4U << 20);
    for (const auto& sequence : page.sequences()) seen += sequence.display_name()[0];
    token = page.next_page_token();
  } while (!token.empty());
  EXPECT_EQ(seen, "gfedcba");
}

}  // namespace
}  // namespace depthtween::server
