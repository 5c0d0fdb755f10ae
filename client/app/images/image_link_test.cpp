// SPDX-License-Identifier: Apache-2.0
// Two cameras of a wearer over the middleware, on this host.
#include "client/app/images/image_link.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>
#include <unistd.h>

#include <functional>
#include <sstream>

#include "client/app/viewer/test_map.h"
#include "common/wire/log_redirect.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

class ImageLinkTest : public ::testing::Test {
 protected:
  /// A frame of a camera's every so often, until something is so.
  bool frames_until(ImageLink& camera, const std::function<bool()>& predicate,
                    std::chrono::milliseconds limit = 20s, cv::Size size = {640, 480}) {
    const auto image = std::make_shared<const GrayImage>(size.width, size.height);
    const auto deadline = std::chrono::steady_clock::now() + limit;
    while (!predicate()) {
      if (std::chrono::steady_clock::now() > deadline) return false;
      Frame frame;
      frame.image = image;
      frame.time = {static_cast<int64_t>(++frames_)};
      FrameResult result;
      const MapSnapshotPtr snapshot;
      const LabelListPtr labels;
      camera.on_frame({frames_, frame, result, FrameState::kLost, snapshot, labels, {}, {}, {}, {}, {}, {}});
      std::this_thread::sleep_for(5ms);
    }
    return true;
  }
  [[nodiscard]] std::unique_ptr<ImageLink> open(const std::string& wearer, const std::string& name,
                                                Logger log = null_logger()) const {
    return ImageLink::open({wearer, name, domain_}, testing::test_camera(), std::move(log)).value();
  }

  const wire::LogRedirect quiet_{null_logger()};
  /// There is no server; the ports of the domain are those of wearers' cameras alone.
  const int domain_ = 5 + getpid() % 95;
  size_t frames_ = 0;
};

TEST_F(ImageLinkTest, ImagesComeWhileTheyAreAskedForAndNotAfter) {
  const auto hand = open("ada", "hand");
  const auto shoulder = open("ada", "shoulder");
  const auto other = open("bob", "hat");
  ASSERT_TRUE(
      frames_until(*shoulder, [&] { return !hand->cameras().empty() && !shoulder->cameras().empty(); }));
  EXPECT_THAT(hand->cameras(), ElementsAre("shoulder"));
  EXPECT_THAT(other->cameras(), IsEmpty()) << "of another wearer";
  EXPECT_EQ(shoulder->summary().sent, 0U) << "nobody has asked";

  const auto asked_at = std::chrono::steady_clock::now();
  hand->choose("shoulder");
  ASSERT_TRUE(frames_until(*shoulder, [&] { return hand->summary().received >= 5; }));
  const OtherView view = hand->view();
  EXPECT_EQ(view.pixels.size(), cv::Size(640, 480));
  EXPECT_EQ(view.state, FrameState::kLost);
  EXPECT_TRUE(view.is_there);

  hand->choose("");
  // Until the camera has heard it: then no frame is one too many.
  size_t before = 0;
  ASSERT_TRUE(frames_until(*shoulder, [&] {
    return shoulder->summary().asked > 0ns && std::exchange(before, shoulder->summary().sent) == before;
  }));
  const auto asked_for = std::chrono::steady_clock::now() - asked_at;
  EXPECT_FALSE(frames_until(
      *shoulder, [&] { return shoulder->summary().sent > before; }, 300ms));
  EXPECT_LE(static_cast<double>(before), 2 + 10 * std::chrono::duration<double>(asked_for).count());
  EXPECT_GT(shoulder->summary().cpu, 0ns);
  EXPECT_EQ(hand->summary().cpu, 0ns) << "nobody asked for its images";
}

TEST_F(ImageLinkTest, AnImageThatCannotBeDrawnIsToldAndTheNextOneIsSent) {
  std::ostringstream said;
  const auto hand = open("ada", "hand");
  const auto shoulder =
      open("ada", "shoulder",
           std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::ostream_sink_mt>(said)));
  hand->choose("shoulder");
  ASSERT_TRUE(frames_until(*shoulder, [&] { return hand->summary().received > 0; }));
  const size_t before = shoulder->summary().sent;
  EXPECT_FALSE(
      frames_until(*shoulder, [&] { return shoulder->summary().sent > before + 2; }, 500ms, {100, 100}))
      << "images of another size than the camera's";
  const size_t received = hand->summary().received;
  EXPECT_TRUE(frames_until(*shoulder, [&] { return hand->summary().received > received + 2; }));
  shoulder->close();
  EXPECT_THAT(said.str(), ::testing::HasSubstr("images of the wearer's cameras: "));
}

TEST_F(ImageLinkTest, AViewerThatEndsAsksNoMoreAndACameraThatEndsHasGone) {
  auto shoulder = open("ada", "shoulder");
  {
    const auto hand = open("ada", "hand");
    hand->choose("shoulder");
    ASSERT_TRUE(frames_until(*shoulder, [&] { return hand->summary().received > 0; }));
  }
  ASSERT_TRUE(frames_until(*shoulder, [&] { return shoulder->summary().asked > 0ns; }));
  const auto hand = open("ada", "hand");
  hand->choose("shoulder");
  ASSERT_TRUE(frames_until(*shoulder, [&] { return hand->summary().received > 0 && hand->view().is_there; }));
  shoulder.reset();
  const auto deadline = std::chrono::steady_clock::now() + 20s;
  while (hand->view().is_there && std::chrono::steady_clock::now() < deadline)
    std::this_thread::sleep_for(5ms);
  EXPECT_FALSE(hand->view().is_there);
  EXPECT_FALSE(hand->view().pixels.empty()) << "the last image is shown, and said to be old";
}

TEST_F(ImageLinkTest, MoreCamerasThanThereArePlacesForAreToldSo) {
  std::vector<std::unique_ptr<ImageLink>> all;
  for (int i = 0; i < wire::kMaxWearerCameras; ++i) all.push_back(open("ada", "camera-" + std::to_string(i)));
  const auto refused = ImageLink::open({"ada", "one-more", domain_}, testing::test_camera(), null_logger());
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kRefused);
}

}  // namespace
}  // namespace cairn
