// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <functional>
#include <memory>

#include "client/session/session.h"
#include "server/endpoint/service.h"

/// What the integration tests share: a domain of their own, polling with a deadline.
namespace cairn::testing {

/// Polls until `predicate` holds; false when it does not within the limit, which only a broken program
/// reaches.
[[nodiscard]] bool eventually(const std::function<bool()>& predicate,
                              std::chrono::milliseconds limit = std::chrono::seconds(60));

/// Candidates for this process, all below the ports that the kernel gives out; each call the next one.
[[nodiscard]] int next_domain();

/// A service in a domain that nobody uses; its domain is left in `options`.
[[nodiscard]] std::unique_ptr<Service> start_service(ServiceOptions* options);

/// The same once more, in the domain of its options, when the one before has ended.
[[nodiscard]] std::unique_ptr<Service> start_same_service(const ServiceOptions& options);

/// A session on this host. Fails the test when it cannot be opened.
[[nodiscard]] std::unique_ptr<Session> open_session(const SessionOptions& options, const CameraPtr& camera);

/// The same, when the server has answered it and knows its name.
[[nodiscard]] std::unique_ptr<Session> open_known_session(const SessionOptions& options,
                                                          const CameraPtr& camera);

/// A plain 400x300 camera.
[[nodiscard]] CameraPtr test_camera();

}  // namespace cairn::testing
