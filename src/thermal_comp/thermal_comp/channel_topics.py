# SPDX-License-Identifier: Apache-2.0
"""Topics of the channels that effects can need beyond the die temperature."""

from geometry_msgs.msg import Vector3Stamped
from sensor_msgs.msg import RelativeHumidity, Temperature
from std_msgs.msg import Float64

CHANNEL_TOPICS = {
    'chamber_temperature': ('chamber/temperature', Temperature, 'temperature'),
    'device_temperature': ('chamber/device_temperature', Temperature, 'temperature'),
    'humidity': ('chamber/humidity', RelativeHumidity, 'relative_humidity'),
    'heater': ('chamber/heater', Float64, 'data'),
    'compressor': ('chamber/compressor', Float64, 'data'),
    'fan': ('chamber/fan', Float64, 'data'),
    'supply_voltage': ('imu/supply_voltage', Float64, 'data'),
    'vibration': ('imu/vibration', Vector3Stamped, 'vector'),
}
"""Topic, type and field of the channels an effect can need beyond the die temperature."""
