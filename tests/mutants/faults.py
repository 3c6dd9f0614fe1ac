"""List the deliberate faults that `make mutants` plants in the physics code. Each fault has a list of the quick tests that must detect the
fault.

A section of the table starts with a module under radartwin/ and the test files under tests/ that must fail. Each row has four columns: the
function (its __qualname__), an expression or statement that occurs once in the function, its faulty replacement, and the meaning of the
fault.
"""

TABLE = """
materials/layers: physics/test_materials
stack_coefficients | kz[outer] - kz[inner] | kz[inner] - kz[outer] | TE reflection has the wrong sign
stack_coefficients | media[inner] * kz[outer] - media[outer] * kz[inner] | kz[outer] - kz[inner] | TM reflection ignores the permittivities
stack_coefficients | -1j * k0 | 1j * k0 | a lossy layer amplifies
stack_coefficients | r_te + te * once**2 | r_te + te * once | the wave crosses a layer once, not twice
stack_coefficients | t_te * once * through_te | t_te * through_te | a layer transmits without phase and loss
stack_coefficients | np.asarray(cos_incidence, float) ** 2 | np.asarray(cos_incidence, float) | the sine of the incidence is wrong

materials/itu: physics/test_materials
permittivity | 1j * conductivity | 2j * conductivity | the conductivity is doubled
permittivity | 1j * conductivity | -1j * conductivity | a material amplifies

materials/roughness: physics/test_materials
ament | -2 | -1 | Ament's factor applies to the power
ament_transmitted | -0.5 | -2 | roughness reduces transmission as much as reflection

materials/containers: physics/test_materials
water | 1j * gamma_1 | 0j * gamma_1 | water has one relaxation, not two
looyenga | np.asarray(eps) ** (1 / 3) | np.asarray(eps) ** (1 / 2) | Looyenga's mixing law has the wrong power

materials/distance: materials/test_minc
_level | 10 * np.log10(np.maximum(power, 1e-30)) | 20 * np.log10(np.maximum(power, 1e-30)) | decibels are doubled

simulation/rcs: physics/test_rcs
rcs | 2 * wavenumber * total | wavenumber * total | the far-field cross-section is 6 dB low
rcs | stand_off**4 | stand_off**3 | the near field falls with the wrong power of distance
rcs | hits.length_in_m + hits.length_out_m | hits.length_in_m - hits.length_out_m | the return length is subtracted

simulation/curved/tracer: physics/test_rcs physics/test_tubes
Tracer.__init__ | 2 * np.pi * float(table.frequencies_hz.mean()) | np.pi * float(table.frequencies_hz.mean()) | half the wavenumber

simulation/curved/scatter: physics/test_rcs physics/test_tubes physics/test_rims
_footprint | 8 * np.pi * contact.cosine | 4 * np.pi * contact.cosine | a footprint radiates 6 dB too much
scatter | electric + magnetic | electric - magnetic | magnetic currents have the wrong sign
_footprint | 0.5 * wavenumber | 0.25 * wavenumber | the second-order phase of a footprint is halved
_footprint | dr.abs(phase) < MOST_PHASE | dr.abs(phase) < 1e30 | tubes of any width have an echo
footprint_moments | dr.sincos(beta * float(node * node)) | dr.sincos(-beta * float(node * node)) | the second-order phase has the wrong sign
footprint_integral | share & (1 << bit) != 0 | share & (8 >> bit) != 0 | a tube contributes on the wrong sides of its centre ray
triangle_integral | (im_a - im_b) * scale | (im_b - im_a) * scale | the integral over a piece is conjugated
piece_integral | alpha[0] * x + alpha[1] * y + second(x, y) | alpha[0] * x + second(x, y) | a piece has no phase along one axis

simulation/curved/borders: physics/test_rims physics/test_tubes
_is_border | not solid or first > 0 or second > 0 | not solid or (first > 0 and second > 0) | half-lit rims do not cut
_projected | (u - scale[0]) / scale[2] + 0.5 | (u - scale[0]) / scale[2] | borders are shifted by half a tube

simulation/curved/division: physics/test_tubes
divided | ~(1 << bit) | ~(8 >> bit) | a tube ends on the wrong sides of its centre ray
_narrow_tubes | (place > 0) * 1 | (place >= 0) * 1 | narrow tubes reach beyond their square

simulation/curved/rims: physics/test_rims
_face | (dot(z, away) - cosine) * cot | 0 * cot | fringe currents have the form in the plane perpendicular to the edge
_face | mu * cot * b | 0 * b | oblique waves have no fringe currents along the edge
_face | 1 / opening - (1.0 if lit else 0.0) | 1 / opening | physical optics ends at the edge without charges
hits | grid.covers(pose, rims.middle[piece]) | np.ones(len(pose), bool) | each grid around a place has the echoes of all rims
_strengths | 2 * math.pi * (1.0 if plane else there * back) | 4 * math.pi * (1.0 if plane else there * back) | fringe currents are halved
_inside | sign * dot(rims.normal[m, 1], ray) < 0 | True | a rim is hidden although the radar sees one of its faces

simulation/curved/contact: physics/test_rcs physics/test_tubes
bounce | 2 * contact.cosine | contact.cosine | a curved mirror has half its power
count_caustics | mi.UInt32(1) | mi.UInt32(3) | a caustic has the wrong phase

simulation/curved/shell: physics/test_shells
find_shells | 1j * wavenumber | -1j * wavenumber | a wall's thickness shifts the phase the wrong way
find_shells | layered(material).layers[::-1] | () | a wall has no layers from inside

simulation/curved/transit: physics/test_shells
Sheets.enter | near.outside | ~near.outside | tubes enter a shell from its inside only

simulation/curved/jones: physics/test_rcs physics/test_shells
_meet | b[i] * turn_cos - a[i] * turn_sin | b[i] * turn_cos + a[i] * turn_sin | a field turns the wrong way
_amplitudes | complex(value.imag, value.real) | complex(value.imag, -value.real) | an amplitude is conjugated

simulation/reflection_table: physics/test_crossing
_evaluate | 2j * np.pi | 0j * np.pi | the transmission of a sheet contains the phase of the air that it replaces

simulation/flat/crossing: physics/test_crossing
cross_panes | abs(_place(tree, other, start, way) - place) < SAME_M | False | the common side of two triangles counts as two panes
_fill | range(ways) | range(1) | an echo crosses a pane once, not there and back
delayed | 2j * np.pi * at_hz | 0j * at_hz | the delay of a pane turns the phase twice

simulation/flat/field: physics/test_crossing
edge_terms | shadow * jump[0] | shadow | the edge of a pane casts the shadow of an opaque sheet
travelled | max(crossed(walls.tree, at, to, walls.opaque, pane_ids), 0) | 0 | panes do not weaken the paths of rooms

simulation/diffuse: physics/test_diffuse
_returns | 4 * np.pi * away | 8 * np.pi * away | scattered power is 6 dB low
_block | np.sqrt(power[kept]) | power[kept] | power is used as amplitude
_block | -2 | -1 | half the Doppler shift of diffuse echoes
scattered_share | 1 - coherent**2 | 1 - coherent | roughness removes more power than it scatters
_on_faces | upto[-1] / count / 2 | upto[-1] / count | each scatterer represents twice its area
_returns | narrow * (low + part * (high - low)) | low + part * (high - low) | a wider lobe keeps its peak
mover_paths | ~visibility.hidden(scattered, sensor, obstacles) | slice(None) | other bodies do not hide scatterers of a body

simulation/visibility: physics/test_diffuse
visible | ~geometry.scene.ray_test(ray).numpy() | np.ones(len(distance), bool) | walls do not hide scatterers
negated | -copies.amplitude | copies.amplitude | a hidden scatterer echoes twice
_blocked | obstacle.rotation @ sensor[:, :3, :3] | sensor[:, :3, :3] | obstacles do not turn

materials/scatter_lobe: physics/test_kirchhoff
cross_section | (tangential2 + along**2) ** 2 | along**4 | the obliquity factor is missing
_series | n * log_g - g[i] | n * log_g | the limit of small roughness for every roughness
_series | t[i] / n | t[i] | all orders have the lobe of the first order
scattered_lobe | np.exp(_collected(roughness_m, correlation_m, wavenumber)(np.arccos(cosine))) | 1.0 | the lobe does not conserve energy

simulation/flat/room: physics/test_flat_rooms
FlatRoom._paths | departs + arrives | departs | only the departure has a Doppler shift
FlatRoom._paths | amplitude.conj() | amplitude | the phase of reflections has the wrong sign

simulation/flat/search: physics/test_flat_rooms
_joined | chain[b, n - 1 - j] | chain[b, j] | faces after an edge come in the order from the receiver
_reach | min(max(foot, low + 1e-5), high - 1e-5) | low | the foot of an edge is not tested

simulation/flat/search: simulation/test_cells
beam_planes | min(radius / max(away, 1e-30), 1.0) | 0.0 | the beams of a cell are those of its centre
_cone | (radius + size) / away | size / away | the beam over a face seen edge-on is that of the centre of a cell

simulation/flat/search: simulation/test_large_flats
_can_end | strength * ends.through[e] | 0.0 | beams over which an edge leads back to the radar are left out

simulation/flat/field: simulation/test_cells
reflect_points | margin > 0 | False | a path must exist at the test place itself

simulation/flat/search: physics/test_furnished_rooms
_far | math.sqrt(max(excess, 0.0)) - change | math.sqrt(max(excess, 0.0)) + change | edges are weaker anywhere in a cell than at its centre

simulation/flat/room: physics/test_furnished_rooms
FlatRoom._paths | 2 * np.abs(half) | 0 * half.real | paths that only the middle of the array sees vanish
FlatRoom._paths | first + share * (second - first) | second + share * (first - second) | the channels of the array are in reverse order
_nearest | KDTree(places).query(points)[1] | np.zeros(len(points), int) | all poses use the sequences of the first test place

simulation/flat/field: physics/test_flat_rooms
keller | z_s * h_r + z_r * h_s | z_s * h_s + z_r * h_r | the point of diffraction is not Keller's
doubled_matrix | faces.opening[e] > 0.5 | faces.opening[e] > 0.7 | a wave meets the faces of a corner in the wrong order
doubled_matrix | hh2 * hh1 - sh2 * sh1 | hh2 * hh1 + sh2 * sh1 | the faces of a corner turn the field wrongly
edge_terms | n < 1 | n < 0 | an inner corner continues the incident wave instead of the doubly reflected one

simulation/flat/field: physics/test_three_dimensions
across_share | into * into / size if size > 1e-20 else 0.5 | 1.0 | both edges of a corner have all of its wave
ends_weight | -1.0 if (place <= length if far else place >= 0) else 1.0 | 0.0 | an edge ends abruptly
_legs | path.share[i] += 0.5 | path.share[i] += 1.0 | a ray that grazes a face counts its reflection twice
_kept | min(max(place, inside), length - inside) | place | an edge diffracts beyond its ends

simulation/flat/faces: simulation/test_flat_faces
_extend | max(abs(gap_first), abs(gap_last)) < SAME_M | True | perpendicular plates keep the gap between them
_sectors | abs(opening * order_of_images - 1) < EXACT | False | inner corners of 90 degrees diffract
_without_overlaps | shapely.difference(larger.polygon, cover, grid_size=1e-7) | larger.polygon | equal planes reflect twice

simulation/flat/wedge: simulation/test_flat_faces
half_plane | 1 - rest if v >= 0 else rest | rest if v >= 0 else 1 - rest | light and shadow are swapped
_term | sign * math.pi + beta | sign * math.pi - beta | the boundary is on the wrong side

simulation/flat/kirchhoff: physics/test_shadows
_tail | complex(-im, re) | complex(im, -re) | the edge wave has the wrong sign
edge_part | z_s * math.sqrt(h_r) + z_r * math.sqrt(h_s) | z_s * math.sqrt(h_s) + z_r * math.sqrt(h_r) | the point of least excess is wrong

simulation/flat/shadows: physics/test_shadows
past_faces | side * value | -side * value | edge waves have the wrong sign

simulation/flat/search: physics/test_polygons
beam_planes | length < EQUAL_M | length < 0 | two equal corners bound a beam

simulation/flat/polygons: physics/test_polygons
_edge_of | a[:], b[:] = first, second | a[:], b[:] = a, b | edges of earlier faces diffract on the last face
_fringes | beams.order[b] + others.order[c] >= beams.chain.shape[1] | beams.order[b] + others.order[c] > 0 | no edge in mirrors
_arriving | reflected(body.shape.faces, body.tables, out, way, chain) | 0 | antennas keep their polarisation in mirrors
_beyond | 0.25 * math.pi - u_b * u_b | 0.25 * math.pi + u_b * u_b | the end of a face has the wrong phase

simulation/flat/polygons: physics/test_objects_before_walls
_polygon | 1 - edge_share(a, along, apex, receiver, wavenumber, ends.reach) | 1.0 | the currents that form the shadow count twice
_fringe | shortn * (1 + net) | 0 * (1 + net) | grazing fringe currents do not end with their face
_fringe | (shortn + begunn) * (1 - mirroredn) | 0 * (1 - mirroredn) | grazing fringe currents of an unlit face do not end

simulation/flat/silhouette: physics/test_objects_before_walls
_mean_depth | (1 - square) ** 2 | 1e-9 | the outline of a turning body jumps from edge to edge

simulation/flat/kirchhoff: physics/test_objects_before_walls
reach_around | share * max((aside + radius) / (0.9 * unit) - REACH, 0.0) | 0.0 | far edges of a hoop around the line do not count

simulation/flat/silhouette: physics/test_silhouette
_borders | step if rises else -step | -step if rises else step | left and right ends of intervals are swapped
_intervals | place[n, 0] - right[row, count[row] - 1, 0] < narrowest | True | the gaps between intervals are closed

simulation/flat/shadows: physics/test_silhouette
factors | sensor + NUDGE / wavenumber | sensor | a line over an edge has no factor
_waves | value if side > 0 else -value | -value if side > 0 else value | edge waves have the wrong sign

simulation/flat/shadows: physics/test_objects_before_walls
_path | part[0, e] * onwards | part[0, e] | later lines do not shadow the edge waves of earlier lines

simulation/flat/legs: physics/test_shadows
_mirror | dot(toward(start, source, 1.0), vector(sector, i)) > 0 | False | outer edges of a corner end its mirrors

simulation/curved/tracer: physics/test_tubes
Receivers.of_tubes | self.first[grid[tube]] + place | self.first[grid[tube]] | all receivers of a tube are the first one

simulation/backends/coupling: physics/test_coupling
_found | block.out_leg != block.back_leg | block.out_leg != block.out_leg | paths over the room run in one direction only
_place | direction[n, i] * velocity[r, i] | 0.0 * velocity[r, i] | paths over the room have no Doppler shift
_place | place[r, i] + direction[n, i] * length[n] | place[r, i] + direction[n, i] | legs end one metre from the mirror image
_place | rotation[r, i, 1] * direction[n, 1] | -rotation[r, i, 1] * direction[n, 1] | directions at the sensor are mirrored
_Pairs.weighed | legs.weigh(amplitude, self.place[row], leg[row], point) | legs | legs have no amplitudes
_strong_pairs | [place, share] | [place, 0 * share + share.min()] | pairs of legs have the smallest share of all poses
_found | level >= EARLY * (prune * most[block.frame[hits.pose]]) | np.arange(len(level)) < 1 | only one hit of each block of pairs is kept
_found | close[pairs.frame] | close.any() | one pose close to an object uncouples all poses

simulation/flat/legs: physics/test_coupling
_lines | level.conjugate() | level | a leg is not conjugated

simulation/backends/track_paths: physics/test_places
_carry | shift[f, i] | -shift[f, i] | paths move the wrong way along the track
_carry | total -= turned * velocity[f, i] | total += turned * velocity[f, i] | approaching reads as receding
_points | poses[:, :3, 2] | poses[:, :3, 0] | a radar that rolls has the polarisation of its first pose
covering | 0.5 * spacing_m * (1 + 1e-9) | 2 * spacing_m | paths are moved by four times the permitted distance

simulation/merging: simulation/test_merging
_add | complex(math.cos(middle), math.sin(middle)) | 1.0 | merged paths lose their phase
_add | gain[n] / mean[row, 9] | 1.0 | all paths of a cell have the antenna gain of their mean

simulation/aspects: physics/test_aspects
Aspects.at | self.symmetry * count | count | a symmetric target turns too slowly
_combine | first[f, c, t] + k + 1 | first[f, c, t] + k | aspects are one step behind their angle

simulation/poses: simulation/test_poses
inverse | poses[:, :3, 3] | -poses[:, :3, 3] | the inverse of a pose moves the wrong way
_advanced | share * rotation | 0 * rotation | rotation causes no Doppler shift

simulation/backends/scatterers: physics/test_baselines
PointBackend._object | distance**2 | distance | points fall off as 1/R^2

simulation/signal/synthesis: physics/test_synthesis physics/test_receiver
_motion_terms | 2 * np.pi * reach | np.pi * reach | the Doppler shift is halved
thermal_noise | received / transmitted / 2 | received / transmitted | noise is 3 dB high
thermal_noise | gain * np.asarray(fft.fft(noise)) | np.asarray(fft.fft(noise)) | the IF filter does not shape the thermal noise
_expanded | gain * back | gain | the antenna gain applies at transmission only
received | np.complex64(1j) * phase.reshape(shape) | 0 * phase.reshape(shape) | echoes have no phase noise

simulation/signal/gridding: physics/test_synthesis physics/test_antenna_errors
_element_distance | 2 * length * along | length * along | antenna elements are half as far apart
ripple | departure[p] if k < num_tx else arrival[p] | departure[p] | receivers have the pattern of the departure
_motion | out[k] *= 2 | out[k] *= 1 | the Jacobi-Anger series lacks its factor of two

radar/antenna: radar/test_radar physics/test_receiver
_gains | PEAK_GAIN_DBI - _loss_db(x / across, _AZIMUTH) | 2 * PEAK_GAIN_DBI - _loss_db(x / across, _AZIMUTH) | the gain is the square
_gains | (array * patch) ** 2 | 0 * array | the antenna has no side lobe

radar/antenna_errors: physics/test_antenna_errors
_raise | (back - side) * x | 0 * x | the back lobe has the level of the side lobes
_ripples | 10 ** (errors.ripple_db / 20) / np.sqrt(COPIES) | 10 ** (errors.ripple_db / 20) | ripples are 4.8 dB too strong
AntennaErrors.scaled | 20 * np.log10(strength) | 10 * np.log10(strength) | the strength scales powers

radar/if_filter: physics/test_receiver
IfFilter.gain | beat_hz - 1j * corner | beat_hz + 1j * corner | the high-pass filter delays the phase
IfFilter.gain | 1 - self.pass_share | 1 | the stop band begins beyond the edge of the band

radar/phase_noise: physics/test_receiver physics/test_hardware
_lines | -2j * np.pi | -1j * np.pi | the range correlation is halved
PhaseNoise.processes | self.density(offset) * spacing | self.density(offset) * spacing / 2 | phase noise is 3 dB low

radar/hardware: physics/test_hardware
Hardware.leaked | -self.line_loss_db / 20 | -self.line_loss_db / 10 | line loss is doubled
Hardware.digitised | 1 - np.conj(error) | 1 + np.conj(error) | the mixer's image is as strong as the echo
Hardware.leakage | apart + self.feed_m | apart | leakage does not pass the feed lines

radar/word_order: radar/test_dca1000
Layout.samples | (second, first) if self.q_first else (first, second) | (first, second) | Q is always read as I
Layout.samples | words << (16 - self.bits) >> (16 - self.bits) | words | short words have no sign

radar/ti_files: radar/test_captures
describe | 2 * math.pi / 256 | math.pi / 256 | the phases of transmitters are halved
describe | numbers["separate"] == 0 | numbers["separate"] == 1 | receivers that alternate are read one after the other
describe | 12 + 2 * numbers["adc_bits"] | 16 | words of 12 bits are read as 16 bits

radar/dca1000: radar/test_captures
SampleFile.__init__ | 2 * chirp_bytes + _LONGEST_HEADER | 0 | headers are read as samples

radar/captures: radar/test_captures
_recorded | abs(edge) > EDGE_DB | True | weak noise decides the order of I and Q against the description

radar/processing: physics/test_point_targets radar/test_radar
doppler_fft | -2j * np.pi | 2j * np.pi | the delay between transmitters is corrected the wrong way
response | -1j * wavenumber | 1j * wavenumber | left and right are swapped
range_fft | 2 * profile[..., : bins // 2] | profile[..., : bins // 2] | real samples read 6 dB low
range_axis | 2 * radar.slope_hz_per_s | 1 * radar.slope_hz_per_s | ranges are doubled

radar/cfar: radar/test_cfar
ca_factor | f.isf(false_alarm, 2 * looks, 2 * looks * training) | f.isf(false_alarm, looks, looks * training) | looks are halved
training_mean | total - inner | total | the cell under test counts as noise

radar/covariance: radar/test_angles
Covariance.smoothed | matrix[..., ::-1, ::-1].conj() | matrix[..., ::-1, ::-1] | the backward average is not conjugated
Covariance.loaded | loading * mean | loading * mean * size | the loading refers to the sum of the eigenvalues

radar/angles: radar/test_angles
spectrum | antennas**-0.5 | 1.0 | the spectrum of MUSIC is too low by the number of antennas
spectrum | antennas - method.sources | antennas - method.sources + 1 | the noise subspace holds a signal
AngleSpectrum.__call__ | weights.conj() | weights | the spectrum is no Hermitian form

radar/detection: physics/test_point_clouds
_covariance | -2j * np.pi | 2j * np.pi | the TDM phase is compensated the wrong way

radar/point_messages: radar/test_point_messages
arrays | np.arange(len(clouds), dtype=np.float64) / frame_rate_hz | np.arange(len(clouds), dtype=np.float64) | frames have no time

features/align: features/test_align
overlap | max(0, -frames) | max(0, frames) | the offset has the wrong sign

testbed/unscanned: testbed/test_unscanned
added | np.sqrt(strength * np.mean(whole - inside) / energy) | strength * np.mean(whole - inside) / energy | energy is taken for amplitude
added | whole - inside | whole | the target counts as room
echoes | np.abs(length.reshape(poses, COUNT) - target_m[:, None]) > CLEAR_M | distance > 0 | an echo lies in the target gate

features/profile: features/test_profile
multipath_share | 1 - np.sum(inside) / np.sum(total) | np.sum(inside) / np.sum(total) | the direct share is reported
beyond_target_share | ~gate(range_m, target_m) | gate(range_m, target_m) | the gate counts as beyond the target

features/normalise: features/test_normalise
fit_map | measured_spread / np.where(constant, 1.0, spread) | spread / np.where(constant, 1.0, measured_spread) | inverted map
rank_normalise | rankdata(matrix[rows], axis=0) - 0.5 | rankdata(matrix[rows], axis=0) - 1.0 | ranks begin at zero

features/envelope: features/test_features
target_energy | gate_energies(floor, processed.range_m, target_m)[0] | 0.0 | noise counts as the target's energy
harmonic_ratio | harmonics(envelope, high)[low - 1 :] ** 2 | harmonics(envelope, high)[low - 1 :] | amplitudes are summed
crest_factor | np.sqrt(np.mean(envelope**2)) | np.mean(envelope**2) | the crest factor divides by a power
without_range_law | 4 | 2 | the range law covers one direction only

scene/mesh_file: reconstruct/test_scan_mesh
triangulated | (sine > FLAT).all(axis=1) | (sine < 2).all(axis=1) | the missing corner of a concave floor is filled
_numbers | values / np.iinfo(kind).max | values | quantised coordinates are not normalised
offset_m | np.rint(centre) | 0 * centre | survey coordinates are stored in single precision

scene/scene: reconstruct/test_scan_mesh
Scene.placed | here[..., :3, 3] - offset | here[..., :3, 3] + offset | a track moves away from the room

features/doppler: features/test_features
radial_velocity | limit / np.pi | -limit / np.pi | receding reads as approaching

features/extent: features/test_features
gate_spectrum | spectrum - noise | spectrum | noise widens the target

features/window: features/test_features
energies | np.arange(BINS + 1) - BINS / 2 | np.arange(BINS + 1) | the window starts at the target

features/peak_track: features/test_features
_weighted | np.maximum(processed.power - processed.noise_floor, 0.0) * near | near * 1.0 | the track ignores power

features/signature: features/test_features
signature | np.fft.fftshift(levels(power), axes=0) | levels(power) | zero Doppler lies at the edge of the signature

features/range_time: features/test_pictures
sector_weights | np.minimum(apart, frames - apart) | apart | the revolution of a picture does not close
picture | rows // 2 - kept // 2 | 0 | zero Doppler of a short revolution is not in the middle row

features/processed: features/test_features
process | radar.num_chirps * np.sum(taps**2) | np.sum(taps**2) | the noise floor is that of a single chirp

features/processed: features/test_processed
process | (np.abs(coherent) ** 2).mean(axis=2, dtype=np.float64) | np.abs(coherent.mean(axis=2)) ** 2 | channels are summed coherently

reconstruct/outlines/meeting_planes: reconstruct/test_outlines
_cornered | reach if convex else 0.0 | reach | the inner corner of an L-shaped floor is cut off
_cornered | abs((at - t) * sine) | abs(at - t) | two walls at 150 degrees do not meet
_on_cut | np.sign(gap[1] - gap[0])[apart] | 0 | an edge that ends before the neighbouring plane stays there

reconstruct/outlines/complete: reconstruct/test_outlines
spanned | np.minimum(np.median(counts[counts > 0]), most) | np.median(counts[counts > 0]) | the tip of an acute corner is cut off

reconstruct/segmentation/bodies: reconstruct/test_outlines
room_bounds | segment.normal[2] < 0 | segment.normal[2] < -LEVEL | a wall does not end at the slopes of a roof
"""
