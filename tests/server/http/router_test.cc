// Path templates against the grammar and the examples of google/api/http.proto.
#include "server/http/router.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace depthtween::server {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::Optional;
using testing::Pair;

std::optional<std::map<std::string, std::string>> MatchPath(const std::string& text,
                                                            const std::vector<std::string>& segments) {
  const auto path = PathTemplate::Parse(text);
  EXPECT_TRUE(path.ok()) << path.status();
  return path->Match(segments);
}

TEST(PathTemplate, BindsVariables) {
  EXPECT_THAT(MatchPath("/v1/{name=jobs/*}", {"v1", "jobs", "7"}), Optional(ElementsAre(Pair("name", "jobs/7"))));
  EXPECT_THAT(MatchPath("/v1/{name=jobs/*}/outputs", {"v1", "jobs", "7", "outputs"}),
              Optional(ElementsAre(Pair("name", "jobs/7"))));
  EXPECT_THAT(MatchPath("/v1/{a}/{b.c=x/*}:do", {"v1", "1", "x", "2:do"}),
              Optional(ElementsAre(Pair("a", "1"), Pair("b.c", "x/2"))));
  EXPECT_THAT(MatchPath("/v1/*/x", {"v1", "anything", "x"}), Optional(IsEmpty()));
  EXPECT_THAT(MatchPath("/", {}), Optional(IsEmpty()));
}

// A mistyped verb must not be taken for a name, nor a name for a verb.
TEST(PathTemplate, VerbsAreExact) {
  EXPECT_FALSE(MatchPath("/v1/{name=jobs/*}", {"v1", "jobs", "7:cancel"}));
  EXPECT_FALSE(MatchPath("/v1/{name=jobs/*}:cancel", {"v1", "jobs", "7"}));
  EXPECT_FALSE(MatchPath("/v1/{name=jobs/*}:cancel", {"v1", "jobs", "7:cancle"}));
  EXPECT_FALSE(MatchPath("/v1/{name=jobs/*}:cancel", {"v1", "jobs", ":cancel"}));
  EXPECT_FALSE(MatchPath("/v1/{name=jobs/*}", {"v1", "jobs"}));
  EXPECT_FALSE(MatchPath("/v1/{name=jobs/*}", {"v1", "sequences", "7"}));
  EXPECT_FALSE(MatchPath("/v1/jobs", {"v1", "jobs", "7"}));
}

TEST(PathTemplate, ReadsWell) {
  EXPECT_EQ(PathTemplate::Parse("/v1/{name=sequences/*/uploads/*}:write")->Readable(),
            "/v1/sequences/{sequence}/uploads/{upload}:write");
  EXPECT_EQ(PathTemplate::Parse("/v1/jobs/{id}")->Readable(), "/v1/jobs/{id}");
  EXPECT_EQ(PathTemplate::Parse("/")->Readable(), "/");
  EXPECT_THAT(PathTemplate::Parse("/v1/{a}/{b=x/*}")->variables(), ElementsAre("a", "b"));
}

TEST(PathTemplate, RefusesWhatIsNone) {
  for (const char* text :
       {"", "v1", "/v1/", "/v1//x", "/{", "/{a", "/{=*}", "/{a={b}}", "/x{a}", "/{a}x", "/a:", "/a*", "/{a=}"}) {
    EXPECT_EQ(PathTemplate::Parse(text).status().code(), absl::StatusCode::kInvalidArgument) << text;
  }
}

boost::asio::awaitable<void> Nothing(Exchange&) { co_return; }

TEST(Router, FindsByMethodAndPath) {
  Router router;
  router.Add("GET", "/v1/{name=jobs/*}", Nothing);
  router.Add("DELETE", "/v1/{name=jobs/*}", Nothing);
  router.Add("POST", "/v1/jobs", Nothing);
  const auto found = router.Find("HEAD", {"v1", "jobs", "7"});
  ASSERT_TRUE(found.has_value());
  EXPECT_EQ(*found->path, "/v1/{name=jobs/*}");
  EXPECT_THAT(found->path_values, ElementsAre(Pair("name", "jobs/7")));
  EXPECT_FALSE(router.Find("POST", {"v1", "jobs", "7"}));
  EXPECT_THAT(router.Methods({"v1", "jobs", "7"}), ElementsAre("DELETE", "GET", "HEAD", "OPTIONS"));
  EXPECT_THAT(router.Methods({"v1", "jobs"}), ElementsAre("OPTIONS", "POST"));
  EXPECT_THAT(router.Methods({"v1", "nothing"}), IsEmpty());
}

}  // namespace
}  // namespace depthtween::server
