// Every method of every service of ours, found through the descriptors, called with every kind of token; and links.
// What must come of it follows from the `scope` option beside the method.
#include <google/protobuf/descriptor.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/support/byte_buffer.h>

#include <chrono>
#include <set>

#include "depthtween/v1/access.pb.h"
#include "depthtween/v1/admin.grpc.pb.h"
#include "grpc/health/v1/health.grpc.pb.h"
#include "server/rpc/method_rules.h"
#include "tests/server/rpc/rpc_fixture.h"

namespace depthtween::server {
namespace {

using google::protobuf::MethodDescriptor;

std::vector<const MethodDescriptor*> AllMethods() {
  std::vector<const MethodDescriptor*> methods;
  for (const auto* file : {v1::Sequence::descriptor()->file(), v1::Job::descriptor()->file(),
                           v1::Output::descriptor()->file(), v1::ServerInfo::descriptor()->file()}) {
    for (int i = 0; i < file->service_count(); ++i) {
      for (int k = 0; k < file->service(i)->method_count(); ++k) methods.push_back(file->service(i)->method(k));
    }
  }
  return methods;
}

class AccessTest : public RpcTest {
 protected:
  AccessTest() { guard_options.token_file = file_; }

  std::string Make(std::set<Scope> scopes, const std::string& tenant = kDefaultTenant) {
    return Take(AddToken(file_, {.tenant = tenant, .scopes = std::move(scopes)}));
  }

  // Calls a method of any kind with these bytes as its request and this secret, if it is not empty.
  grpc::Status Call(const MethodDescriptor& method, const std::string& secret, const std::string& bytes = "") {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
    if (!secret.empty()) context.AddMetadata("authorization", "Bearer " + secret);
    grpc::CompletionQueue queue;
    grpc::GenericStub stub(channel());
    const auto call = stub.PrepareCall(&context, "/" + method.service()->full_name() + "/" + method.name(), &queue);
    const auto wait = [&queue] {
      void* tag = nullptr;
      bool ok = false;
      return queue.Next(&tag, &ok) && ok;
    };
    call->StartCall(nullptr);
    wait();
    const grpc::Slice request(bytes);
    call->Write(grpc::ByteBuffer(&request, 1), nullptr);
    wait();
    call->WritesDone(nullptr);
    wait();
    grpc::ByteBuffer answer;
    do {
      call->Read(&answer, nullptr);
    } while (wait());
    grpc::Status status;
    call->Finish(&status, nullptr);
    wait();
    return status;
  }

  const TemporaryFolder token_folder_;
  const std::string file_ = token_folder_ / "tokens.json";
};

TEST_F(AccessTest, EveryMethodNamesItsScope) {
  std::set<std::string> names;
  for (const MethodDescriptor* method : AllMethods()) {
    EXPECT_THAT(ParseScopes(method->options().GetExtension(v1::scope)), IsOk()) << method->full_name();
    EXPECT_TRUE(names.insert(method->name()).second) << method->name() << ": rules go by the name without the service";
  }
  EXPECT_GT(names.size(), 20U);
  EXPECT_EQ(ScopeOfMethod("NoSuchMethod"), Scope::kAdmin);
}

TEST_F(AccessTest, EveryMethodAsksForATokenWithItsScope) {
  const std::map<Scope, std::string> only = {{Scope::kRead, Make({Scope::kRead})},
                                             {Scope::kWrite, Make({Scope::kWrite})},
                                             {Scope::kAdmin, Make({Scope::kAdmin})}};
  const std::string expired = Make({Scope::kRead, Scope::kWrite, Scope::kAdmin});
  std::string text = ReadText(file_);
  text.insert(text.rfind("\"create_time\""), "\"expire_time\": \"2020-01-01T00:00:00Z\",\n      ");
  WriteText(file_, text);

  for (const MethodDescriptor* method : AllMethods()) {
    SCOPED_TRACE(method->full_name());
    EXPECT_THAT(Call(*method, ""), Fails(grpc::UNAUTHENTICATED, "NO_TOKEN"));
    EXPECT_THAT(Call(*method, "", "\xff\xff\xff"), Fails(grpc::UNAUTHENTICATED, "NO_TOKEN")) << "not even rubbish";
    EXPECT_THAT(Call(*method, "dt_guess"), Fails(grpc::UNAUTHENTICATED, "BAD_TOKEN"));
    EXPECT_THAT(Call(*method, expired), Fails(grpc::UNAUTHENTICATED, "EXPIRED_TOKEN"));
    for (const auto& [scope, secret] : only) {
      const grpc::Status status = Call(*method, secret);
      if (scope == ScopeOfMethod(method->name())) {
        EXPECT_NE(status.error_code(), grpc::UNAUTHENTICATED);
        EXPECT_NE(status.error_code(), grpc::PERMISSION_DENIED);
      } else {
        EXPECT_THAT(status, Fails(grpc::PERMISSION_DENIED, "WRONG_SCOPE"));
      }
    }
  }
}

TEST_F(AccessTest, HealthNeedsNoToken) {
  Make({Scope::kRead});
  grpc::ClientContext context;
  grpc::health::v1::HealthCheckResponse response;
  EXPECT_THAT(grpc::health::v1::Health::NewStub(channel())->Check(&context, {}, &response), Succeeds());
}

TEST_F(AccessTest, AnotherTenantsResourcesDoNotExist) {
  const std::string mine = Make({Scope::kRead, Scope::kWrite}, "mine");
  const std::string other = Make({Scope::kRead, Scope::kWrite}, "other");
  const auto with = [](grpc::ClientContext& context, const std::string& secret) {
    context.AddMetadata("authorization", "Bearer " + secret);
    return &context;
  };
  grpc::ClientContext create, get, get_other, list_other;
  v1::Sequence made, seen;
  ASSERT_THAT(sequences_stub().CreateSequence(with(create, mine), {}, &made), Succeeds());
  v1::GetSequenceRequest request;
  request.set_name(made.name());
  EXPECT_THAT(sequences_stub().GetSequence(with(get, mine), request, &seen), Succeeds());
  EXPECT_THAT(sequences_stub().GetSequence(with(get_other, other), request, &seen),
              Fails(grpc::NOT_FOUND, "NO_SUCH_RESOURCE"));
  v1::ListSequencesResponse list;
  EXPECT_THAT(sequences_stub().ListSequences(with(list_other, other), {}, &list), Succeeds());
  EXPECT_EQ(list.sequences_size(), 0);
}

// A link opens what it was made for, and nothing else, without a token.
TEST_F(RpcTest, ALinkOpensItsResourceAlone) {
  const TemporaryFolder folder;
  const v1::Job job = CreateJob(ReadySequence());
  WaitUntilEnded(job.name());
  v1::CreateLinkRequest request;
  request.set_name(job.name() + "/outputs/report");
  grpc::ClientContext create, read, read_other, write;
  v1::Link link;
  ASSERT_THAT(outputs_stub().CreateLink(&create, request, &link), Succeeds());
  EXPECT_EQ(link.name(), request.name());
  EXPECT_GT(link.expire_time().seconds(), 0);

  const auto follow = [&](grpc::ClientContext& context, const std::string& name) {
    context.AddMetadata("depthtween-link", link.signature());
    v1::ReadOutputRequest wanted;
    wanted.set_name(name);
    const auto reader = outputs_stub().ReadOutput(&context, wanted);
    v1::ReadOutputResponse piece;
    while (reader->Read(&piece)) {
    }
    return reader->Finish();
  };
  EXPECT_THAT(follow(read, link.name()), Succeeds());
  EXPECT_THAT(follow(read_other, job.name() + "/outputs/camera"), Fails(grpc::UNAUTHENTICATED, "BAD_LINK"));
  // Also what there is to say of its job, and no more links.
  grpc::ClientContext look, more;
  look.AddMetadata("depthtween-link", link.signature());
  v1::GetJobRequest get;
  get.set_name(job.name());
  v1::Job seen;
  EXPECT_THAT(jobs_stub().GetJob(&look, get, &seen), Succeeds());
  more.AddMetadata("depthtween-link", link.signature());
  v1::Link another;
  EXPECT_THAT(outputs_stub().CreateLink(&more, request, &another), Fails(grpc::PERMISSION_DENIED, "WRONG_SCOPE"));
  write.AddMetadata("depthtween-link", link.signature());
  v1::CancelJobRequest cancel;
  cancel.set_name(link.name());
  v1::Job answer;
  EXPECT_THAT(jobs_stub().CancelJob(&write, cancel, &answer), Fails(grpc::PERMISSION_DENIED, "WRONG_SCOPE"));
}

TEST_F(RpcTest, ALinkIsMadeOnlyForWhatIsThere) {
  v1::CreateLinkRequest request;
  v1::Link link;
  grpc::ClientContext missing, wrong, life;
  request.set_name("jobs/0000000000000000/outputs/depth");
  EXPECT_THAT(outputs_stub().CreateLink(&missing, request, &link), Fails(grpc::NOT_FOUND, "NO_SUCH_RESOURCE"));
  request.set_name("elsewhere");
  EXPECT_THAT(outputs_stub().CreateLink(&wrong, request, &link), FailsAtField("name"));
  request.mutable_lifetime()->set_seconds(100'000);
  EXPECT_THAT(outputs_stub().CreateLink(&life, request, &link), FailsAtField("lifetime"));
}

}  // namespace
}  // namespace depthtween::server
