# SPDX-License-Identifier: Apache-2.0
"""What both robust filters measure: averages over short steps, what they mean and how well."""
