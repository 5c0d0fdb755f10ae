// SPDX-License-Identifier: Apache-2.0
#include "client/session/sender.h"

#include <utility>

#include "common/base/overloaded.h"

namespace cairn {

Result<std::unique_ptr<Sender>> Sender::start(SharedCore& core, const wire::Participant& participant,
                                              const std::string& partition, wire::ImageEncoding encoding,
                                              Logger log) {
  auto writers = wire::create_all<wire::Writer<wire::CameraMessage>, wire::Writer<wire::TrackerStateMessage>,
                                  wire::Writer<wire::MapSeed>, wire::Writer<wire::KeyframeOffer>,
                                  wire::Writer<wire::RelocQuery>, wire::Writer<wire::ClientRequest>>(
      participant, partition);
  if (!writers) return tl::unexpected(writers.error());
  auto& [cameras, tracker, seeds, offers, queries, requests] = *writers;
  CommandHeader header;
  header.client = core.look([](const SessionCore& c) { return c.client(); });
  header.lockstep = core.look([](const SessionCore& c) { return c.options().lockstep; });
  header.as_proposals = core.look([](const SessionCore& c) { return c.options().reads_only; });
  header.encoding = encoding;
  return std::unique_ptr<Sender>(new Sender(core,
                                            {std::move(cameras), std::move(tracker), std::move(seeds),
                                             std::move(offers), std::move(queries), std::move(requests)},
                                            std::move(header), std::move(log)));
}

Sender::Sender(SharedCore& core, Writers writers, CommandHeader header, Logger log)
    : core_(core),
      writers_(std::move(writers)),
      header_(std::move(header)),
      log_(std::move(log)),
      thread_([this] { run(); }) {}

Sender::~Sender() {
  thread_.join();
}

void Sender::run() {
  while (true) {
    try {
      const auto next = core_.wait_for_next([this] { return readers(); });
      if (!next) return;
      write(*next);
    } catch (const std::exception& error) {  // what can not be sent must not end the tracker
      if (warning_.due()) log_->error("sending failed: {}", error.what());
      core_.apply([](SessionCore& core) { core.written(false); });  // if it was the camera
    }
  }
}

SessionCore::Readers Sender::readers() const {
  return {writers_.queries.matched() > 0, writers_.seeds.matched() > 0, writers_.offers.matched() > 0,
          writers_.requests.matched() > 0};
}

void Sender::write(const SessionCore::Outgoing& outgoing) {
  std::visit(Overloaded{
                 [&](const wire::CameraMessage& camera) { write_camera(camera); },
                 [&](const wire::TrackerStateMessage& state) {
                   report(writers_.tracker.write(state), "TrackerState");
                 },
                 [&](const QuerySlot::Sendable& query) {
                   report(writers_.queries.write(make_message(query, header_)), "RelocQuery");
                 },
                 [&](const SeedSlot::Sendable& seed) {
                   report(writers_.seeds.write(make_message(seed, header_)), "MapSeed");
                 },
                 [&](const SessionCore::Offer& offer) {
                   report(writers_.offers.write(make_message(offer, header_)), "KeyframeOffer");
                 },
                 [&](const RequestSpool::Sendable& request) {
                   report(writers_.requests.write(make_message(request, header_)), "ClientRequest");
                 },
             },
             outgoing);
}

void Sender::write_camera(const wire::CameraMessage& camera) {
  const Status written = writers_.camera.write(camera);
  report(written, "Camera");
  if (written) header_.camera = camera;
  core_.apply([&](SessionCore& core) { core.written(written.has_value()); });
}

void Sender::report(const Status& written, const char* what) {
  if (!written && warning_.due()) log_->warn("{} could not be sent: {}", what, written.error().message);
}

}  // namespace cairn
