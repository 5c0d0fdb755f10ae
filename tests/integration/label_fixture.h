// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/session/label_request.h"
#include "common/io/test_directory.h"
#include "tests/integration/key_ring.h"
#include "tests/integration/test_domain.h"
#include "tests/integration/two_views.h"

namespace cairn::testing {

/// A service with a store, and anna, who makes a map of a scene and labels it.
class LabelFixture : public ::testing::Test {
 protected:
  using Texts = std::vector<std::string>;

  explicit LabelFixture(std::chrono::seconds drop_after = {}, bool is_secured = false) {
    service_options_.store = folder_.path();
    service_options_.drop_after = drop_after;
    if (is_secured) {
      keys_.emplace();
      service_options_.security = keys_->of(IdentityRole::kServer, "server");
    }
    service_ = start_service(&service_options_);
    anna_ = open("anna");
  }
  std::unique_ptr<Session> open(const std::string& name, bool reads_only = false) {
    SessionOptions options = client(name);
    options.reads_only = reads_only;
    return open_known_session(options, scene_.camera());
  }
  SessionOptions client(const std::string& name) {
    SessionOptions options;
    options.domain = service_options_.domain;
    options.name = name;
    if (keys_) options.security = keys_->of(IdentityRole::kClient, name);
    return options;
  }
  void make_map() {
    anna_->send_seed(make_seed(scene_));
    ASSERT_TRUE(anna_->wait_for_map(std::chrono::seconds(60))) << anna_->status().text;
    map_ = anna_->snapshot()->map;
  }
  /// With the same domain and store.
  void start_service_again() { service_ = start_same_service(service_options_); }

  std::optional<RequestReply> ask(Session& session, wire::ClientRequest request) {
    session.send_request(std::move(request));
    std::vector<RequestReply> replies;
    (void)eventually([&] { return !(replies = session.take_request_replies()).empty(); });
    return replies.size() == 1 ? std::optional(replies.front()) : std::nullopt;
  }
  /// A label at what the second keyframe sees at a pixel.
  wire::ClientRequest new_label(const std::string& text) {
    const MapSnapshot& map = *anna_->snapshot();
    const SE3& camera_from_map = map.find(KeyframeId{2})->camera_from_map;
    return *request_new_label(map, camera_from_map, camera_from_map.inverse() * kSeen, text);
  }
  LabelId add(Session& session, const std::string& text) {
    const auto reply = ask(session, new_label(text));
    EXPECT_TRUE(reply && reply->done) << (reply ? reply->reason : "no reply");
    return reply ? reply->label : LabelId{};
  }
  Texts texts(const Session& session) {
    Texts found;
    if (const LabelListPtr labels = session.labels(map_)) {
      for (const Label& label : *labels) found.push_back(label.text);
    }
    return found;
  }

  const Eigen::Vector3d kSeen{0.1, 0.05, 1};  ///< by the second keyframe, in its frame
  const Scene scene_{11};
  const TestDirectory folder_;
  std::optional<KeyRing> keys_;  ///< of a secured site
  ServiceOptions service_options_;
  std::unique_ptr<Service> service_;
  std::unique_ptr<Session> anna_;
  MapId map_;
};

}  // namespace cairn::testing
