# SPDX-License-Identifier: Apache-2.0
"""The verbs of the command line; each is one module with HELP, arguments(parser), run(options).

This file imports nothing: the set-up reads it to make one executable per verb.
"""

COMMANDS: dict[str, str] = {
    'import': 'import_file',
    'fit': 'fit',
    'compare': 'compare',
    'apply': 'apply',
    'export': 'export',
    'second-opinion': 'second_opinion',
    'still': 'still',
    'report': 'report',
    'demo': 'demo',
    'simulate': 'simulate',
    'reveal': 'reveal',
    'reproduce': 'reproduce',
    'plan': 'plan',
    'campaign': 'campaign',
    'replay': 'replay',
    'orient': 'orient',
    'diagnose': 'diagnose',
    'add': 'add',
    'auto': 'auto',
    'next-experiment': 'next_experiment',
    'check-tables': 'check_tables',
    'explain': 'explain',
    'check-effect': 'check_effect',
    'fleet': 'fleet',
    'serve': 'serve',
}
"""Verb → module in this package. A verb's executable comes from here as well."""
