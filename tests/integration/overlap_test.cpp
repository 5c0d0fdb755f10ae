// SPDX-License-Identifier: Apache-2.0
// A map that grows over another is reported to the operator, for as long as there are both.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "common/io/test_directory.h"
#include "server/admin/admin_client.h"
#include "server/store/store.h"
#include "tests/integration/test_domain.h"
#include "tests/integration/two_views.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using testing::eventually;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class OverlapTest : public ::testing::Test {
 protected:
  void start(bool with_store) {
    if (with_store) options_.store = folder_.path();
    service_ = testing::start_service(&options_);
    connect();
  }
  void restart() {
    admin_.reset();
    service_.reset();
    service_ = testing::start_same_service(options_);
    connect();
  }
  void connect() {
    AdminClientOptions connection;
    connection.domain = options_.domain;
    auto admin = AdminClient::connect(connection);
    ASSERT_TRUE(admin) << admin.error().message;
    admin_.emplace(std::move(*admin));
  }
  /// A map of a scene, and the session that has made it.
  std::unique_ptr<Session> make_map(const std::string& name, const testing::Scene& scene) {
    SessionOptions options;
    options.domain = options_.domain;
    options.name = name;
    options.lockstep = true;
    auto session = testing::open_known_session(options, scene.camera());
    session->send_seed(testing::make_seed(scene));
    EXPECT_TRUE(session->wait_until_settled(60s)) << session->status().text;
    EXPECT_NE(session->snapshot(), nullptr);
    return session;
  }
  static void grow(Session* session, const testing::Scene& scene) {
    for (const int step : {4, 6, 8, 10}) {
      testing::Frame frame = testing::make_offer(scene, *session->snapshot(), step);
      session->send_offer(std::move(frame.proposal), std::move(frame.image), Timestamp{step});
      ASSERT_TRUE(session->wait_until_settled(60s)) << step;
    }
    EXPECT_GT(session->snapshot()->keyframe_count(), 4U);
  }
  [[nodiscard]] json ask(const json& request) {
    const auto answer = admin_->ask(request);
    EXPECT_TRUE(answer) << answer.error().message;
    return answer ? answer->content : json();
  }
  [[nodiscard]] json overlaps_of(const std::string& map) {
    return ask({{"verb", "show"}, {"map", map}})["overlaps"];
  }
  /// Names of the maps that it overlaps.
  [[nodiscard]] std::vector<std::string> neighbours_of(const std::string& map) {
    std::vector<std::string> names;
    for (const json& overlap : overlaps_of(map)) names.push_back(overlap["map"]);
    return names;
  }
  [[nodiscard]] std::string cairnctl(const std::string& words) const {
    const std::string line =
        std::string(CAIRNCTL_PROGRAM) + " --domain " + std::to_string(options_.domain) + " " + words;
    FILE* pipe = popen(line.c_str(), "r");
    if (pipe == nullptr) return {};
    std::string said;
    std::array<char, 4096> buffer{};
    for (size_t n = 0; (n = fread(buffer.data(), 1, buffer.size(), pipe)) > 0;) said.append(buffer.data(), n);
    EXPECT_EQ(pclose(pipe), 0);
    return said;
  }
  using Names = std::vector<std::string>;

  const testing::Scene desk_{11};
  const testing::Scene elsewhere_{12};
  const TestDirectory folder_;
  ServiceOptions options_;
  std::unique_ptr<Service> service_;
  std::optional<AdminClient> admin_;
};

TEST_F(OverlapTest, OfAllMapsThoseOfOnePlaceAreReportedFromBothSides) {
  start(false);
  const auto first = make_map("first", desk_);
  grow(first.get(), desk_);
  const auto second = make_map("second", elsewhere_);
  grow(second.get(), elsewhere_);
  const auto third = make_map("third", desk_);
  grow(third.get(), desk_);
  // Keyframes are asked about in the order in which they came, so the second map has had its turn.
  ASSERT_TRUE(eventually([&] { return neighbours_of("map-3") == Names{"map-1"}; }));
  EXPECT_THAT(overlaps_of("map-2"), IsEmpty());
  EXPECT_EQ(neighbours_of("map-1"), Names{"map-3"});

  const json overlap = overlaps_of("map-3")[0];
  EXPECT_GE(overlap["keyframes"], 3);
  EXPECT_EQ(overlap["its_keyframes"], 0) << "there was no other map of the place";
  // The last keyframes may yet be asked about.
  EXPECT_TRUE(eventually(
      [&] { return overlaps_of("map-1")[0]["its_keyframes"] == overlaps_of("map-3")[0]["keyframes"]; }));
  EXPECT_GT(overlap["found"], 0);
  for (const json& map : ask({{"verb", "maps"}})["maps"])
    EXPECT_EQ(map["overlaps"].size(), map["name"] == "map-2" ? 0U : 1U) << map["name"];
  EXPECT_THAT(cairnctl("maps list"), HasSubstr("overlaps map-3: 0 of its keyframes show that map"));
  EXPECT_THAT(cairnctl("map map-3 show"), HasSubstr("overlaps map-1"));

  (void)ask({{"verb", "rename"}, {"map", "map-1"}, {"name", "desk"}});
  EXPECT_EQ(neighbours_of("map-3"), Names{"desk"});
  (void)ask({{"verb", "delete"}, {"map", "desk"}, {"for_good", true}});
  EXPECT_THAT(overlaps_of("map-3"), IsEmpty());
}

TEST_F(OverlapTest, ARestartKeepsItAndItGoesAndComesWithItsMaps) {
  start(true);
  {
    const auto first = make_map("first", desk_);
    grow(first.get(), desk_);
    const auto second = make_map("second", desk_);
    grow(second.get(), desk_);
    ASSERT_TRUE(eventually([&] { return neighbours_of("map-2") == Names{"map-1"}; }));
  }
  ASSERT_NO_FATAL_FAILURE(restart());
  EXPECT_EQ(neighbours_of("map-2"), Names{"map-1"});
  EXPECT_EQ(neighbours_of("map-1"), Names{"map-2"});

  (void)ask({{"verb", "delete"}, {"map", "map-1"}});
  EXPECT_THAT(overlaps_of("map-2"), IsEmpty());
  ASSERT_NO_FATAL_FAILURE(restart());
  EXPECT_THAT(overlaps_of("map-2"), IsEmpty());
  EXPECT_EQ(ask({{"verb", "undelete"}, {"map", "map-1"}})["overlaps"].size(), 1U);
  EXPECT_EQ(neighbours_of("map-2"), Names{"map-1"});

  (void)ask({{"verb", "delete"}, {"map", "map-1"}});
  (void)ask({{"verb", "purge"}, {"map", "map-1"}});
  ASSERT_NO_FATAL_FAILURE(restart());
  service_.reset();
  const auto store = Store::open(folder_.path(), null_logger());
  ASSERT_TRUE(store) << store.error().message;
  EXPECT_THAT((*store)->overlaps(), IsEmpty());
}

}  // namespace
}  // namespace cairn
