// SPDX-License-Identifier: Apache-2.0
#include "client/session/session_messages.h"

#include "client/session/image_encoder.h"

namespace cairn {

wire::MapSeed make_message(const SeedSlot::Sendable& sendable, const CommandHeader& header) {
  const SeedProposal& proposal = *sendable.item;
  wire::MapSeed message;
  message.client = header.client;
  message.command = sendable.command;
  message.camera = header.camera.camera;
  message.camera_version = header.camera.version;
  message.lockstep = header.lockstep;
  message.first_time = proposal.first_time;
  message.second_time = proposal.second_time;
  message.first_image = encode_image(*proposal.first_image, header.encoding);
  message.second_image = encode_image(*proposal.second_image, header.encoding);
  message.trails = proposal.trails;
  message.second_from_first = proposal.second_from_first;
  message.still_mask = bits_of(proposal.still);
  message.second_up = proposal.second_up;
  return message;
}

wire::KeyframeOffer make_message(const SessionCore::Offer& offer, const CommandHeader& header) {
  const KeyframeProposal& proposal = offer.sendable.item->proposal;
  wire::KeyframeOffer message;
  message.client = header.client;
  message.command = offer.sendable.command;
  message.map = proposal.map;
  message.epoch = proposal.epoch;
  message.revision = proposal.revision;
  message.reference = proposal.reference;
  message.camera_from_reference = proposal.camera_from_reference;
  message.camera = header.camera.camera;
  message.camera_version = header.camera.version;
  message.lockstep = header.lockstep;
  message.time = offer.sendable.item->time;
  message.image = encode_image(*offer.sendable.item->image, header.encoding);
  message.measurements = proposal.measurements;
  message.candidates = proposal.candidates;
  message.reference_command = offer.reference;
  message.still_mask = bits_of(proposal.still);
  message.up = proposal.up;
  message.as_proposal = header.as_proposals;
  return message;
}

wire::RelocQuery make_message(const QuerySlot::Sendable& sendable, const CommandHeader& header) {
  const SentRelocQuery& query = *sendable.item;
  wire::RelocQuery message;
  message.client = header.client;
  message.command = sendable.command;
  message.map_hint = query.map_hint;
  message.camera = header.camera.camera;
  message.camera_version = header.camera.version;
  message.lockstep = header.lockstep;
  message.time = query.time;
  message.small_image = encode_image(query.view->small, wire::ImageEncoding::kRaw);
  message.corners = query.view->corners;
  message.up = query.view->up;
  return message;
}

wire::ClientRequest make_message(const RequestSpool::Sendable& sendable, const CommandHeader& header) {
  wire::ClientRequest message = *sendable.item;
  message.client = header.client;
  message.command = sendable.command;
  return message;
}

}  // namespace cairn
