# SPDX-License-Identifier: Apache-2.0
"""Campaigns with hidden effects that share no equation with the project's own simulator.

Written from notes on the physics alone, with numpy and scipy; of the project only the type
ImuRecording and the bag writer are used. One integer seed makes one campaign:

    from independent_simulator.campaign import draw_campaign
    campaign = draw_campaign(7, 'full_lab')
    campaign.recordings, campaign.truth.to_dict()

surroundings.py   what happens round the device: chamber, room, freezer, hair-dryer
laws.py           the effects of the catalogue and laws outside it, as functions of what happens
device.py         noise, thermometer, quantisation and the rows a logger keeps
scenarios.py      recordings as people make them
campaign.py       one campaign and the truth about it
"""
