// SPDX-License-Identifier: Apache-2.0
//
// What is well formed and means nothing. Each message goes by the wire to a whole server; it is refused by
// one of the two, in words that say what is wrong, and the server goes on as before. What the server says
// meanwhile is taken by who hears it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "common/base/utf8.h"
#include "server/service/simulation/lone_client_fixture.h"

namespace cairn::simulation {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr Timestamp kYear3000{std::numeric_limits<int64_t>::max()};  // as near as a clock gets
constexpr double kFar = 9e5;

/// A way to spoil a message, and words of the refusal. Without words, it only must not be accepted.
template <typename Message>
struct Case {
  const char* what;
  std::function<void(Message&)> spoil;
  const char* words;
};

// ---- images

void put_16(uint32_t value, std::vector<uint8_t>* out) {
  out->push_back(static_cast<uint8_t>(value >> 8));
  out->push_back(static_cast<uint8_t>(value));
}

void put_frame(uint32_t side, std::vector<uint8_t>* out) {
  out->insert(out->end(), {0xFF, 0xC0, 0, 11, 8});
  put_16(side, out);
  put_16(side, out);
  out->insert(out->end(), {1, 1, 0x11, 0});
}

constexpr std::array<uint8_t, 10> kScan{0xFF, 0xDA, 0, 8, 1, 1, 0, 0, 63, 0};

/// A few bytes that say to be so large. `later`: what a second header says.
wire::ImageMessage tiny_jpeg(uint32_t side, uint32_t later = 0, int scans = 1) {
  wire::ImageMessage image{wire::ImageEncoding::kJpeg, 160, 120, {0xFF, 0xD8}};
  put_frame(side, &image.bytes);
  for (int i = 0; i < scans; ++i) image.bytes.insert(image.bytes.end(), kScan.begin(), kScan.end());
  if (later > 0) put_frame(later, &image.bytes);
  image.bytes.insert(image.bytes.end(), {0xFF, 0xD9});
  return image;
}

/// Whose first chunk, unknown to a decoder, has a small size where the header's would be.
wire::ImageMessage tiny_png() {
  wire::ImageMessage image{
      wire::ImageEncoding::kJpeg, 160, 120, {0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n'}};
  const std::vector<uint8_t> small{0, 0, 0, 13, 'a', 'a', 'A', 'a', 0, 0, 0, 160, 0, 0, 0, 120};
  const std::vector<uint8_t> large{8,   0,   0,   0, 0, 0,   0,   0,   0,   0,   0,    0,    13,   'I',
                                   'H', 'D', 'R', 0, 0, 128, 0,   0,   0,   128, 0,    8,    0,    0,
                                   0,   0,   0,   0, 0, 0,   'I', 'E', 'N', 'D', 0xAE, 0x42, 0x60, 0x82};
  for (const auto& chunk : {small, large}) image.bytes.insert(image.bytes.end(), chunk.begin(), chunk.end());
  return image;
}

wire::ImageMessage of_text(const std::string& text) {
  return {wire::ImageEncoding::kJpeg, 160, 120, {text.begin(), text.end()}};
}

struct ImageCase {
  const char* what;
  wire::ImageMessage image;
  const char* words;
};
const std::vector<ImageCase>& images() {
  static const std::vector<ImageCase> kAll{
      {"four gigapixels", tiny_jpeg(65535), "sides from 1 to 4096"},
      {"a gigapixel that hides behind a small frame", tiny_jpeg(32767, 120), "two frames"},
      {"a thousand walks over all pixels", tiny_jpeg(4096, 0, 1000), "more than 100 scans"},
      {"a gigapixel behind a chunk in front", tiny_png(), "does not begin with its header"},
      {"a comment that ends for some", of_text("P5 #\r30000 30000 255\n160 120\n255\n."),
       "sides from 1 to 4096"},
      {"a comment that is none", of_text("P5\n4096#262144 255\n160\n255\n."), "not three numbers"},
      {"another size than is said", tiny_jpeg(64), "not "},
      {"no image", of_text("kettle"), "not an image"},
      {"another size than the camera's",
       {wire::ImageEncoding::kRaw, 8, 8, std::vector<uint8_t>(64)},
       "camera"}};
  return kAll;
}

class Nonsense : public LoneClientFixture {
 protected:
  template <typename Command>
  void refuse(const std::vector<Case<Command>>& cases, const Command& sound) {
    for (const auto& [what, spoil, words] : cases) {
      SCOPED_TRACE(what);
      Command bad = sound;
      spoil(bad);
      const std::string reason = judge(bad);
      EXPECT_NE(reason, "") << "it was taken";
      EXPECT_THAT(reason, HasSubstr(words));
      EXPECT_FALSE(fault_of_text(reason)) << "a reason can be shown";
    }
  }
};

TEST_F(Nonsense, OffersAreRefusedByName) {
  using Offer = wire::KeyframeOffer;
  const std::vector<Case<Offer>> cases{
      {"of a map that nobody knows", [](Offer& o) { o.map.bytes.fill(9); }, "does not know the map"},
      {"on an offer that came to nothing", [](Offer& o) { o.reference_command = 1; }, "is not in this map"},
      {"of the last epoch of all", [](Offer& o) { o.epoch = {~uint64_t{0}}; }, "another epoch"},
      {"of no epoch", [](Offer& o) { o.epoch = {}; }, "another epoch"},
      {"on a keyframe that never was", [](Offer& o) { o.reference = {1'000'000}; },
       "is not in the map any more"},
      {"on no keyframe", [](Offer& o) { o.reference = {}; }, "is not in the map any more"},
      {"of points that never were",
       [](Offer& o) {
         for (PointMeasurement& m : o.measurements) m.id.value += ~uint64_t{0} / 2;
       },
       "0 good measurements"},
      {"of one point 8192 times", [](Offer& o) { o.measurements.assign(8192, o.measurements[0]); },
       "good measurements"},
      {"of points far outside",
       [](Offer& o) {
         for (PointMeasurement& m : o.measurements) m.pixel = {16000, -16000};
       },
       "0 good measurements"},
      {"from far away",
       [](Offer& o) {
         o.camera_from_reference = SE3(Eigen::Quaterniond::Identity(), {kFar, -kFar, kFar});
       },
       "good measurements"},
      {"from nowhere",
       [](Offer& o) {
         o.camera_from_reference = SE3(Eigen::Quaterniond::Identity(), {kNan, 0, 0});
       },
       "length out of range"},
      {"by a camera that was never announced", [](Offer& o) { o.camera = 77; }, "camera 77 in version 1"},
      {"by another version of the camera", [](Offer& o) { o.camera_version = ~0U; },
       "camera 0 in version 4294967295"},
      {"in the year 3000", [](Offer& o) { o.time = kYear3000; }, "time out of range"},
      {"of 8193 measurements", [](Offer& o) { o.measurements.resize(8193, o.measurements[0]); },
       "count out of range"},
      {"that was masked by another camera", [](Offer& o) { o.still_mask.assign(7, 1); },
       "mask of the wrong size"},
      {"of no camera that looks up",
       [](Offer& o) {
         o.up = UpDirection{{0, 0, kNan}, 0.1};
       },
       "up is not"}};
  refuse(cases, sound_offer(6));
  for (const ImageCase& c : images()) {
    refuse<Offer>({{c.what, [&](Offer& o) { o.image = c.image; }, c.words}}, sound_offer(6));
  }
  EXPECT_EQ(judge(sound_offer(6)), "") << "a sound one is taken as before";
}

TEST_F(Nonsense, SeedsAreRefusedByName) {
  using Seed = wire::MapSeed;
  const std::vector<Case<Seed>> cases{
      {"no trails", [](Seed& s) { s.trails.clear(); }, "trails"},
      {"one trail 4000 times", [](Seed& s) { s.trails.assign(kMaxTrails, s.trails[0]); }, ""},
      {"trails far outside",
       [](Seed& s) {
         for (Trail& t : s.trails) t.second = {-16000, 16000};
       },
       "trails"},
      {"a camera that has not moved", [](Seed& s) { s.second_from_first = SE3(); }, ""},
      {"a camera that has moved far",
       [](Seed& s) {
         s.second_from_first = SE3(Eigen::Quaterniond::Identity(), {kFar, kFar, -kFar});
       },
       ""},
      {"not a number",
       [](Seed& s) {
         s.second_from_first = SE3(Eigen::Quaterniond::Identity(), {0, kNan, 0});
       },
       "length out of range"},
      {"a camera that was never announced", [](Seed& s) { s.camera = 77; }, "camera 77 in version 1"},
      {"in the year 3000", [](Seed& s) { s.second_time = kYear3000; }, "time out of range"},
      {"a name that moves the cursor",
       [](Seed& s) {
         s.map_name =
             "desk\xc2\x9b"
             "2J";
       },
       "cannot be seen"},
      {"a name that is no UTF-8",
       [](Seed& s) {
         s.map_name =
             "K\xfc"
             "che";
       },
       "no UTF-8"},
      {"4001 trails", [](Seed& s) { s.trails.resize(kMaxTrails + 1, s.trails[0]); }, "count out of range"}};
  refuse(cases, views_.seed());
  for (const ImageCase& c : images()) {
    const auto spoil = [&](Seed& s) { s.first_image = s.second_image = c.image; };
    refuse<Seed>({{c.what, spoil, c.words}}, views_.seed());
  }
  EXPECT_EQ(judge(views_.seed()), "") << "a sound one makes a map as before";
}

TEST_F(Nonsense, QueriesAreRefusedByName) {
  using Query = wire::RelocQuery;
  const std::vector<Case<Query>> cases{
      {"by a camera that was never announced", [](Query& q) { q.camera = 77; }, "camera 77 in version 1"},
      {"an image of another size",
       [](Query& q) {
         q.small_image = {wire::ImageEncoding::kRaw, 512, 512, std::vector<uint8_t>(512 * 512)};
       },
       ""},
      {"an image larger than small",
       [](Query& q) {
         q.small_image = {wire::ImageEncoding::kRaw, 513, 1, std::vector<uint8_t>(513)};
       },
       "not a small raw image"},
      {"a packed image", [](Query& q) { q.small_image = tiny_jpeg(65535); }, "not a small raw image"},
      {"nothing in sight",
       [](Query& q) {
         q.corners.clear();
         q.small_image.bytes.assign(q.small_image.bytes.size(), 0);
       },
       ""},
      {"corners far outside",
       [](Query& q) {
         for (PlaceCorner& c : q.corners) c.pixel = {16000, -16000};
       },
       ""},
      {"one corner 1024 times", [](Query& q) { q.corners.assign(1024, q.corners[0]); }, ""},
      {"1025 corners", [](Query& q) { q.corners.resize(1025, q.corners[0]); }, "count out of range"},
      {"in the year 3000", [](Query& q) { q.time = kYear3000; }, "time out of range"}};
  refuse(cases, views_.query(3));
}

TEST_F(Nonsense, RequestsForLabelsAreRefusedByName) {
  using Request = wire::ClientRequest;
  Request sound;
  sound.map = map_;
  sound.text = "kettle";
  sound.epoch = snapshot_->epoch;
  sound.reference = KeyframeId{1};
  sound.reference_from_label = SE3(Eigen::Quaterniond::Identity(), {0, 0, 1});
  const std::vector<Case<Request>> cases{
      {"in a map that nobody knows", [](Request& r) { r.map.bytes.fill(9); }, "does not know the map"},
      {"another name for a label that never was",
       [](Request& r) {
         r.action = wire::RequestAction::kRenameLabel;
         r.label = {~uint64_t{0}};
       },
       "no such label"},
      {"without a label that never was", [](Request& r) { r.action = wire::RequestAction::kRemoveLabel; },
       "no such label"},
      {"at a keyframe that never was", [](Request& r) { r.reference = {1'000'000}; }, "point at it again"},
      {"in the last epoch of all", [](Request& r) { r.epoch = {~uint64_t{0}}; }, "point at it again"},
      {"as far as can be said",
       [](Request& r) {
         r.reference_from_label = SE3(Eigen::Quaterniond::Identity(), {1e6, -1e6, 1e6});
       },
       "too far"},
      {"nowhere",
       [](Request& r) {
         r.reference_from_label = SE3(Eigen::Quaterniond::Identity(), {kNan, 0, 0});
       },
       "length out of range"},
      {"of nothing that can be seen", [](Request& r) { r.text = "\xe3\x80\x80"; }, "needs a text"},
      {"that moves the cursor",
       [](Request& r) {
         r.text =
             "a\xc2\x9b"
             "2J";
       },
       "cannot be seen"},
      {"that turns the line around",
       [](Request& r) {
         r.text =
             "a\xe2\x80\xae"
             "b";
       },
       "cannot be seen"},
      {"that is no UTF-8", [](Request& r) { r.text = "\xff\xfe"; }, "no UTF-8"},
      {"of a megabyte", [](Request& r) { r.text.assign(1'000'000, 'x'); }, "too long"},
      {"of no kind", [](Request& r) { r.kind = static_cast<LabelKind>(200); }, "kind of label"},
      {"of no action", [](Request& r) { r.action = static_cast<wire::RequestAction>(200); },
       "unknown action"}};
  refuse(cases, sound);
  EXPECT_EQ(judge(sound), "") << "a sound one is taken as before";
}

struct AdminCase {
  std::string request;
  const char* words;
};

TEST_F(Nonsense, OperatorsAreRefusedByName) {
  const std::string deep = std::string(20'000, '[') + std::string(20'000, ']');
  const auto granted = [](const std::string& within, const std::string& more = "") {
    return R"({"verb":"rights-grant","to":"ann","map":"desk","right":"write","within":)" + within + more +
           "}";
  };
  const std::vector<AdminCase> cases{
      {"kettle", "no JSON object"},
      {"[1, 2]", "no JSON object"},
      {R"({"verb": )" + deep + "}", "no JSON object"},
      {R"({"verb": 5})", "without 'verb'"},
      {R"({"verb": "explode", "map": "desk"})", "does not know 'explode'"},
      {R"({"verb": "explode\u009b2J", "map": "desk"})", "does not know"},
      {R"({"verb": "show", "map": "\u202emap"})", "no map"},
      {R"({"verb": "show", "map": 5})", "no map"},
      {R"({"verb": "rename", "map": "desk", "name": "a\u009b2J"})", "a-z"},
      {R"({"verb": "rename", "map": "desk", "name": ")" + std::string(40'000, 'x') + "\"}", "a-z"},
      {R"({"verb": "copy", "map": "desk", "name": "../desk"})", "a-z"},
      {R"({"verb": "tag", "map": "desk", "tag": "../../v1"})", "a-z"},
      {R"({"verb": "roll-back", "map": "desk", "tag": "never"})", "never"},
      {R"({"verb": "untag", "map": "desk", "tag": "never"})", "never"},
      {R"({"verb": "undelete", "map": "00112233445566778899aabbccddeeff"})", "no "},
      {R"({"verb": "purge", "map": "../../etc"})", "no "},
      {R"({"verb": "label-remove", "map": "desk", "label": 18446744073709551615})", "no label"},
      {R"({"verb": "label-rename", "map": "desk", "label": -1, "text": "x"})", "no label"},
      {R"({"verb": "import-begin", "token": "../../etc/passwd"})", "transfer"},
      {R"({"verb": "import-write", "token": "import-1", "offset": 18446744073709551615})", "transfer"},
      {R"({"verb": "import", "token": "never"})", "transfer"},
      {R"({"verb": "export-read", "token": "never", "offset": 0})", "transfer"},
      {R"({"verb": "backup-part", "part": "../../etc/passwd"})", "no backup"},
      {R"({"verb": "rights-grant", "to": "Anna B.", "map": "desk", "right": "read"})", "a-z"},
      {R"({"verb": "rights-grant", "to": "ann", "map": "never", "right": "read"})", "no map"},
      {R"({"verb": "rights-grant", "to": "ann", "map": "desk", "right": "all\u009b"})", "no right is called"},
      {granted(R"({"box": [[0, 0, 0], [1e999, 1, 1]]})"), "no JSON object"},
      {granted(R"({"box": [[0, 0, 0], [-1, 1, 1]]})"), "no inside"},
      {granted(R"({"box": [[0, 0], [1, 1]]})"), "three numbers"},
      {granted(R"({"center": [0, 0, 0], "radius": -1})"), "not positive"},
      {granted(R"({"center": [0, 0, 0], "radius": "wide"})"), "no number"},
      {granted(R"({"margin": -1})"), "negative"},
      {granted(R"({"margin": 1})", R"(, "until": "3000-01-01")"), "is no time"},
      {granted(R"({"margin": 1})", R"(, "until": "1999-01-01")"), "is over already"},
      {R"({"verb": "rights-group", "group": "crew", "members": [1, 2]})", "a name"},
      {R"({"verb": "map-freeze", "map": "desk", "why": ")" + std::string(5000, 'x') + "\"}",
       "1000 bytes at most"},
      {R"({"verb": "map-freeze", "map": "desk", "why": "a\u001b[2J"})", "the reason"},
      {R"({"verb": "client-block", "client": "*"})", "a-z"},
      {R"({"verb": "rights-explain", "client": "group crew", "map": "desk"})", "one client"},
      {R"({"verb": "audit", "from": "3000-01-01"})", "is no time"}};
  for (const AdminCase& c : cases) {
    SCOPED_TRACE(c.request.substr(0, 120));
    const std::string reason = ask(c.request);
    EXPECT_NE(reason, "") << "it was done";
    EXPECT_THAT(reason, HasSubstr(c.words));
    EXPECT_FALSE(fault_of_text(reason)) << "a reason can be shown";
  }
  EXPECT_THAT(ask(std::string(wire::kMaxAdminText + 1, ' ')), HasSubstr("too long"));
  EXPECT_THAT(ask("{}", std::vector<uint8_t>(wire::kMaxAdminData + 1)), HasSubstr("count out of range"));
  EXPECT_EQ(ask(R"({"verb": "show", "map": "desk"})"), "") << "it is there as before";
  EXPECT_FALSE(json::parse(reply_->text).contains("failed"));
  EXPECT_EQ(ask(R"({"verb": "audit"})"), "") << "the log of it can be read";
}

/// A refusal names what others have written, which may be long: it arrives all the same.
TEST_F(Nonsense, LongReasonsArrive) {
  const std::string why(1000, 'x');
  ASSERT_EQ(ask(R"({"verb": "map-freeze", "map": "desk", "why": ")" + why + "\"}"), "");
  EXPECT_THAT(judge(sound_offer(6)), HasSubstr("the map is frozen"));
}

}  // namespace
}  // namespace cairn::simulation
