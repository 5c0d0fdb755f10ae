// SPDX-License-Identifier: Apache-2.0
#include "server/service/places.h"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <utility>

#include "server/service/map_runner.h"

namespace cairn {
namespace {

/// Describes an answer for the log: the candidate answered or, where none is believed, the one with the most
/// inliers.
std::string describe(const RelocalizationAnswer& answer) {
  if (answer.candidates.empty()) return answer.reason;
  const PlaceCandidate& best =
      !has_place(answer.verdict)
          ? *std::max_element(answer.candidates.begin(), answer.candidates.end(),
                              [](const auto& a, const auto& b) { return a.inliers < b.inliers; })
          : answer.candidates.front();
  return fmt::format(
      "map {}, keyframe {}, {} matched corners, {} of {} points found, {} keyframes verified{}{}",
      to_hex(best.map.bytes).substr(0, 8), best.keyframe.value, best.matches, best.inliers, best.expected,
      answer.candidates.size(), best.reason.empty() ? "" : ": ", best.reason);
}

/// Removes from an answer candidates that are not of these maps. If any is removed, and no confirmed place is
/// left, the answer says that the client is to ask again.
void leave_out_others(const MapSet& maps, RelocalizationAnswer* answer) {
  const size_t found = answer->candidates.size();
  std::erase_if(answer->candidates, [&](const PlaceCandidate& place) { return !maps.contains(place.map); });
  const bool has_any = std::any_of(answer->candidates.begin(), answer->candidates.end(),
                                   [](const PlaceCandidate& place) { return place.confirmed; });
  if (answer->candidates.size() == found || (has_any && answer->verdict == RelocalizationVerdict::kConfirmed))
    return;
  // Whether one of the others would have been found instead, the next query says.
  *answer = {RelocalizationVerdict::kNotThere, {}, "the maps that count have changed meanwhile; ask again"};
}

}  // namespace

Places::Places(const ServiceContext& context, Clients& clients, Sessions& sessions, const ServedMaps& maps)
    : context_(context),
      clients_(clients),
      sessions_(sessions),
      maps_(maps),
      runner_(std::make_shared<RelocalizationRunner>(
          RelocalizationRunner::Executors{context.executors.urgent, context.executors.queries,
                                          context.executors.background},
          context.options.relocalization, context.options.clock, context.log, context.options.work_times)) {
  if (context_.store != nullptr) overlaps_.restore(context_.store->at_start().overlaps);
  watch_for_overlaps();
}

void Places::watch_for_overlaps() {
  const auto index = [places = std::weak_ptr(runner_)] {
    const auto runner = places.lock();
    return runner ? runner->index() : std::make_shared<const PlaceIndex>();
  };
  const auto tell = [this](const Overlap& overlap) {
    context_.post([this, overlap] { on_overlap(overlap); });
  };
  const auto watch = std::make_shared<OverlapWatch>(context_.executors.idle, context_.options.relocalization,
                                                    index, tell, context_.log, context_.options.work_times);
  runner_->listen({[watch](const auto& map, auto views) { watch->note_searched(map, views); },
                   [watch](const MapId& map) { watch->remove(map); }});
}

void Places::note_revised(MapRevision revision) {
  runner_->report(std::move(revision.snapshot), std::move(revision.views), std::move(revision.indexed),
                  std::move(revision.offered));
}

void Places::on_overlap(const Overlap& overlap) {
  const auto one = maps_.array().all().find(overlap.maps.one);
  const auto other = maps_.array().all().find(overlap.maps.other);
  if (one == maps_.array().all().end() || other == maps_.array().all().end()) return;  // deleted meanwhile
  if (!overlaps_.note(overlap, context_.wall())) return;
  context_.log->warn(
      "map {} overlaps map {}: {} of its keyframes show what is in that map, {} of that map's what is in "
      "this; `cairnctl maps` keeps count",
      one->second.name, other->second.name, overlap.of_one, overlap.of_other);
}

void Places::keep_overlaps() {
  static constexpr std::chrono::seconds kRetryAfter(30);  // a full disk is not full for a second only
  if (context_.store == nullptr || context_.now() < overlaps_wait_until_ || !overlaps_.take_changed()) return;
  context_.store->run([this, all = overlaps_.all()](const Store& store) {
    const Status kept = store.keep_overlaps(all);
    if (kept) return;
    context_.log->error("overlaps of maps are not kept: {}; tried again in {} s", kept.error().message,
                        kRetryAfter.count());
    context_.post([this] {
      overlaps_.change_again();
      overlaps_wait_until_ = context_.now() + kRetryAfter;
    });
  });
}

CameraPtr Places::best_known(const Client& client, uint32_t camera, const AnnouncedCamera& announced) const {
  if (!announced.prior) return announced.camera;
  for (const auto& [map, entry] : maps_.array().all()) {
    for (const CameraEstimate& estimate : entry.statistics.cameras) {
      if (estimate.frozen && estimate.version.client == client.id && estimate.version.camera == camera)
        return estimate.camera;
    }
  }
  return announced.camera;
}

void Places::refuse(const Client& client, wire::CommandId command, std::string why) {
  on_answered(client.name, command, {RelocalizationVerdict::kNotThere, {}, std::move(why)});
}

void Places::take(const Principal& who, wire::RelocQuery message) {
  Client& client = clients_.of(who);
  const wire::CommandId command = message.command;
  if (!sessions_.holds(client, command.session) || client.query_in_work) return;
  if (sessions_.refuses_lockstep(client, message.lockstep)) return;
  const auto rate = client.rates.judge(ClientRates::Kind::kQuery, context_.now(), message.lockstep);
  if (rate == ClientRates::Judgement::kPassOver) return;
  if (rate == ClientRates::Judgement::kRefuse)
    return refuse(client, command, client.rates.why(ClientRates::Kind::kQuery));
  const AnnouncedCamera* announced = client.cameras.find(message.camera, message.camera_version);
  if (announced == nullptr && may_yet_come(client, context_.now())) return;  // it will be asked again
  if (announced == nullptr)
    return refuse(client, command, unknown_camera(message.camera, message.camera_version));
  client.camera_missed_at.reset();
  client.query_in_work = true;
  const WearerRule::Search search = sessions_.wearers().search(
      client.name, maps_.published().readable_by(client.principal()), context_.now());
  context_.executors.queries.submit([this, name = client.name, command,
                                     camera = best_known(client, message.camera, *announced),
                                     message = std::move(message), search]() mutable {
    try {
      look_up(name, camera, std::move(message), search);
    } catch (const std::exception& problem) {  // memory, a library
      context_.post([this, name, command, why = std::string("internal error: ") + problem.what()] {
        on_answered(name, command, {RelocalizationVerdict::kNotThere, {}, why});
      });
    }
  });
}

void Places::look_up(const std::string& client, const CameraPtr& camera, wire::RelocQuery message,
                     const WearerRule::Search& search) {
  const auto done = [this, client, command = message.command,
                     in_part = search.in_part](RelocalizationAnswer answer) {
    context_.post([this, client, command, in_part, answer = std::move(answer)]() mutable {
      const Client* asking = clients_.find(client);
      if (asking == nullptr) return;
      const MapSet readable_now = maps_.published().readable_by(asking->principal());
      // Its rights may have changed while the place was looked for.
      leave_out_others(readable_now, &answer);
      on_answered(
          client, command,
          sessions_.wearers().narrow(client, readable_now, in_part, std::move(answer), context_.now()));
    });
  };
  const Result<GrayImagePtr> small = decode_image(message.small_image);
  if (!small) return done({RelocalizationVerdict::kNotThere, {}, small.error().message});
  RelocalizationQuery query;
  query.camera = camera;
  query.view.small.assign(**small);
  query.view.corners = std::move(message.corners);
  query.view.up = message.up;
  query.scope = search.scope;
  query.lockstep = message.lockstep;
  runner_->ask(std::move(query), done);
}

void Places::on_answered(const std::string& client_name, wire::CommandId command,
                         const RelocalizationAnswer& answer) {
  Client* client = clients_.find(client_name);
  if (client == nullptr) return;
  client->query_in_work = false;
  context_.log->debug("{}: place {}: {}", client_name, to_string(answer.verdict), describe(answer));
  clients_.tell(*client, wire::RelocAnswer{client->id, command, answer});
}

}  // namespace cairn
